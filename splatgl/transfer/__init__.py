"""Transfer functions: values to colour and extinction."""
