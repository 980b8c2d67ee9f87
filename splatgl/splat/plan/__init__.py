"""Settings of a picture, and the plan that draws it."""
