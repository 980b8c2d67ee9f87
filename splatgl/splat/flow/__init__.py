"""Pictures of vectors: streamlines, arrows, and volumes of magnitude and direction."""
