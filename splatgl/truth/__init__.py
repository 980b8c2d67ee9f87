"""Room 4, truth: what the right picture is and how far one is from it."""
