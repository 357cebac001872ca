"""The commands of the command line, by what they are about. They import what they need when they are called."""
