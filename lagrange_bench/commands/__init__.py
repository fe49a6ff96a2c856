"""The commands of the command line: one module each, with its words, its options and what it does."""
