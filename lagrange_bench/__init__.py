"""The command line, and what runs cells."""
