"""The layout of shot and film files as pydantic models, and the values they become."""
