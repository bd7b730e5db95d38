"""A study: profiles, run folders, stages, statistics, figures, report."""
