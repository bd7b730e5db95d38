"""The stages of a run, their settings by profile, and the one loop that saves and shows progress."""
