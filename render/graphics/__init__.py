"""Type, cards, sheets and plots."""
