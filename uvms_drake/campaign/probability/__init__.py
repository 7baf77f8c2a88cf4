"""Certificates in probability from the runs of a campaign."""
