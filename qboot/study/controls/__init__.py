"""The control experiments (section VII): their conditions, and many learners side by side."""
