"""The report: one page on a study, with players of recorded rollouts."""
