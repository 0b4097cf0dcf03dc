"""Where jobs run that do not run here."""
