"""Errata of the paper, as computed data; no other room depends on them.

Nikou, Verginis and Dimarogonas (2018); equations are named by their LaTeX labels, symbols are the
paper's. Every check has the printed values as defaults, and its verdict follows from its numbers:
correct values are not confirmed as an erratum. Random numbers have fixed seeds. Results of sampling
or of a local search are marked as estimates.
"""

from uvms_drake.errata.erratum import Erratum, errata_markdown, errata_table
from uvms_drake.errata.every import all_errata

__all__ = ["Erratum", "all_errata", "errata_markdown", "errata_table"]
