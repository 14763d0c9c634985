"""Corpus folders: check one, make one from a published corpus, track the faces of videos.

python -m training.corpus check DIR
python -m training.corpus convert KIND SOURCE DIR
python -m training.corpus track DIR --model face_landmarker.task
"""

import argparse
import sys
from pathlib import Path

from training.corpus.check import check
from training.corpus.checked import CorpusError
from training.corpus.readers import READERS


def main(arguments: list[str] | None = None) -> int:
    """Entry of the command. Returns 1 if something is wrong."""
    parser = argparse.ArgumentParser(prog="python -m training.corpus", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    checked = commands.add_parser(
        "check", help="report what a folder has, what is odd, and what it can train"
    )
    checked.add_argument("folder", type=Path)
    converted = commands.add_parser("convert", help="make a corpus folder from a published corpus")
    converted.add_argument("kind", choices=list(READERS))
    converted.add_argument("source", type=Path)
    converted.add_argument("folder", type=Path)
    converted.add_argument("--landmarks", type=Path, help="landmarks.json of the corpus's topology")
    tracked = commands.add_parser("track", help="landmarks, weights and head of videos, by MediaPipe")
    tracked.add_argument("folder", type=Path)
    tracked.add_argument("--model", type=Path, required=True, help="face_landmarker.task of MediaPipe")
    args = parser.parse_args(arguments)
    try:
        if args.command == "convert":
            READERS[args.kind](args.source, args.folder, args.landmarks)
        elif args.command == "track":
            from training.corpus.track import track

            track(args.folder, args.model)
        report = check(args.folder)
    except (CorpusError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print("\n".join(report.sentences()))
    return 1 if report.errors else 0


if __name__ == "__main__":
    sys.exit(main())
