"""Previews, live pages, turntables, deliverables, review pages and contact sheets of shots."""
