"""`waam scan` as its command line has it."""

import argparse

from waam_scan import cli


def run(*words):
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())
    args = parser.parse_args(['scan', *map(str, words)])
    return args.run_command(args)
