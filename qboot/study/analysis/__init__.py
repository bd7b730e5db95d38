"""What runs gave: curves, measures, statistics, and verdicts beside what a paper printed."""
