"""`python -m splatgl`."""

from splatgl.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
