"""A process of the benchmark that fails in the way its tasks request."""

import os

from spinor_geom.isolate import serve


def run(task):
    if "say" in task:
        os.write(1, task["say"].encode())
        print(" and printed", flush=True)
    if "exit" in task:
        os._exit(task["exit"])
    return {"status": "done", "process": os.getpid()}


if __name__ == "__main__":
    serve(lambda task, tell: tell(run(task)))
