"""Completion: what Tab completes in shells. Each Tab imports this package, so it holds nothing."""
