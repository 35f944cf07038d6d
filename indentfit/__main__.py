"""`python -m indentfit`: the command line."""

from indentfit.cli import main

if __name__ == "__main__":
    main(prog_name="indentfit")
