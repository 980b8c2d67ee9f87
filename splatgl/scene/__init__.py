"""Scenes from files, arguments and keywords, and the pictures of them."""
