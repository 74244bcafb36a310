from .c99 import INCLUDE as INCLUDE, Exported as Exported, export_c as export_c
