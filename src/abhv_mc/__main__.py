"""``python -m abhv_mc``: the command line."""

from abhv_mc.cli.app import main

if __name__ == "__main__":
    main()
