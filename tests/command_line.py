"""`glapp` in a process of its own, which knows the fits that this run of the tests has made."""

from fits import remember

from glapp.cli import main

if __name__ == "__main__":
    remember()
    main()
