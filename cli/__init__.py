"""The command line: options, and one call into bushseg each."""
