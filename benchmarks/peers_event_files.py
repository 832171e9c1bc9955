"""How fast another library reads an event file: ``python peers_event_files.py LIBRARY CODING FILE WIDTH HEIGHT``.

Runs in an environment of the library's own and prints seconds of processor time, the best of five, and the number of
events, as JSON. Needs nothing of this repository.
"""

import json
import sys
import time


def reader(library, coding, path, size):
    if library == "expelliarmus":
        from expelliarmus import Wizard

        return lambda: len(Wizard(encoding=coding).read(path))
    import faery

    return lambda: len(faery.events_stream_from_file(path, dimensions_fallback=size).to_array())


def main():
    library, coding, path, width, height = sys.argv[1:]
    read = reader(library, coding, path, (int(width), int(height)))
    best = float("inf")
    for _ in range(5):
        began = time.process_time()
        count = read()
        best = min(best, time.process_time() - began)
    print(json.dumps([best, count]))


if __name__ == "__main__":
    main()
