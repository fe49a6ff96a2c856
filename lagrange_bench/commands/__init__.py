"""The commands of the command line. Each module holds one command: its help, its options and its work."""
