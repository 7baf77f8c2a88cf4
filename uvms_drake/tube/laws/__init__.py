"""The tube of each ancillary law, one a file."""
