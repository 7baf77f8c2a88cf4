"""Errata of the paper, as computed data.

Nikou, Verginis and Dimarogonas (2018); equations are named by their LaTeX labels, symbols are the
paper's. Every check has the printed values as defaults, and its verdict follows from its numbers:
correct values are not confirmed as an erratum. Random numbers have fixed seeds. Results of sampling
or of a local search are marked as estimates.
"""

from uvms_drake.papers.nikou2018.errata.erratum import Erratum, errata_markdown, errata_table
from uvms_drake.papers.nikou2018.errata.every import all_errata

__all__ = ["Erratum", "all_errata", "errata_markdown", "errata_table"]
