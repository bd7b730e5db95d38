"""What Slurm says of a job, in the words that Snakemake's cluster-generic executor asks for.

`python -m qboot.study.workflow.slurm_status JOB` prints running, success or failed. It asks the controller alone, so
that it works on clusters without accounting, too.
"""

import subprocess
import sys

RUNNING = {"PENDING", "CONFIGURING", "RUNNING", "COMPLETING", "SUSPENDED", "REQUEUED", "STAGE_OUT", "RESIZING"}


def status_of(description: str) -> str:
    """In Snakemake's word, what a line of `scontrol --oneliner show job` says; the line is empty when it says nothing.

    The controller forgets a job some minutes after its end. Snakemake looks at the files of a job that is said to have
    succeeded, so that is what is said then.
    """
    fields = dict(field.split("=", 1) for field in description.split() if "=" in field)
    state = fields.get("JobState", "COMPLETED")
    if state in RUNNING:
        return "running"
    return "success" if state == "COMPLETED" else "failed"


def main() -> None:
    """Print the status of the job whose number is the only argument."""
    asked = subprocess.run(["scontrol", "--oneliner", "show", "job", sys.argv[1]], capture_output=True, text=True)
    words = asked.stderr.strip()
    # A controller that does not answer is no failure of the job.
    print("running" if asked.returncode and "Invalid job id" not in words else status_of(asked.stdout))


if __name__ == "__main__":
    main()
