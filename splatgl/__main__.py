"""`python -m splatgl`."""

from splatgl.app.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
