"""The command line of the library, and what its commands do."""
