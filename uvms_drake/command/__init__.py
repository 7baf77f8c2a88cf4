"""The command line: arguments, files and messages; it computes nothing itself."""
