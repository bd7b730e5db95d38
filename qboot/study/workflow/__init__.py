"""A study as a workflow of Snakemake, for more than one machine: `Snakefile`, and what a Slurm says of a job."""

from pathlib import Path

SNAKEFILE = Path(__file__).parent / "Snakefile"
