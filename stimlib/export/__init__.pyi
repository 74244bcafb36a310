from .c99 import Exported as Exported, export_c as export_c
