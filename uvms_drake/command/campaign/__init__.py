"""The sub-command `campaign`, and `certify --runs`, which is one, too."""
