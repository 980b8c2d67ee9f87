"""What is asked of a picture, and what is drawn."""
