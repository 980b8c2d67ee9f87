"""Room 1, data: volumes and how they come in, images and how they go out."""
