"""The command line: one subcommand a file, no mathematics. stdout carries data, stderr progress and warnings."""
