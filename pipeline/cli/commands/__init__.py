"""The commands of flowsculpt: one module a command, named like it, with a function of that name."""
