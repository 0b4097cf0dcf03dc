"""Previews, live pages, turntables, deliverables, exports, review pages and contact sheets of shots."""
