"""Entry point of ``python -m abhv_mc``."""

from abhv_mc.cli.app import main

if __name__ == "__main__":
    main()
