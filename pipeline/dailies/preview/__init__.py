"""Quick pictures of a shot without a path tracer: a movie of it, stills, and a page that follows an edit."""
