"""Comparison of pictures: metrics, verdicts, reports and the fixture of pytest."""
