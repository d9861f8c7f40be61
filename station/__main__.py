"""`python -m station` is `station`."""

from station.cli.app import main

main()
