"""What a study stores: files, run folders and what they hold."""
