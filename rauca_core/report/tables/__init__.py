"""Tables in the paper's form: of a study, and the paper's own; as CSV, JSON, LaTeX."""

from .along import curves_of
from .export import tables_csv, tables_json
from .latex import tables_latex
from .model import AVERAGE, BEST, SECOND, Block, Cell, Column, Row, Source, Table, is_normal, is_random, ranks, shown
from .of_study import tables_of, white_box_of
from .paper import PaperTable, odd_averages, paper_tables

__all__ = [
    "AVERAGE",
    "BEST",
    "SECOND",
    "Block",
    "Cell",
    "Column",
    "PaperTable",
    "Row",
    "Source",
    "Table",
    "curves_of",
    "is_normal",
    "is_random",
    "odd_averages",
    "paper_tables",
    "ranks",
    "shown",
    "tables_csv",
    "tables_json",
    "tables_latex",
    "tables_of",
    "white_box_of",
]
