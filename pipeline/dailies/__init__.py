"""What people look at: previews, turntables, slates, deliverables and the review page."""
