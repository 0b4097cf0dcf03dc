"""The commands of flowsculpt: each a function of its name, alone in a module or with its like."""
