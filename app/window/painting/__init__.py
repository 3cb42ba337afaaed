"""What pages are made of, their look, and what is painted on canvases."""
