"""The errors of the paper, as data that is computed; no other room knows of them.

Nikou, Verginis and Dimarogonas (2018); equations go by their LaTeX labels, symbols are the paper's.
Every check takes the printed values as defaults, and its verdict follows from its numbers: of
values that are right, it says so. Random numbers have fixed seeds. A result of sampling, or of a
local search, is an estimate and says so.
"""

from uvms_drake.errata.erratum import Erratum, errata_markdown, errata_table
from uvms_drake.errata.every import all_errata

__all__ = ["Erratum", "all_errata", "errata_markdown", "errata_table"]
