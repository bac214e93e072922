"""A refiner that leaves seeds where they are, but for one fault: `python3 faults.py FAULT [FOLDER]`.

It speaks the protocol itself, without any package. In FOLDER it leaves notes for the tests.
"""

import json
import os
import subprocess
import sys
import time

fault = sys.argv[1]
folder = sys.argv[2] if len(sys.argv) > 2 else "."


def say(answer):
    print(answer if isinstance(answer, str) else json.dumps(answer), flush=True)


def note(name, text):
    with open(os.path.join(folder, name), "a") as file:
        file.write(text + "\n")


def child_that_stays(**options):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"], **options)
    note("children", str(child.pid))


if fault == "crash_at_start":
    sys.exit("no licence found")
if fault == "hang_at_start":
    time.sleep(300)
if fault == "missing_package":
    import a_package_that_nobody_has  # noqa: F401

sys.stdin.readline()
ready = {"protocol": 1, "version": "1", "does": ["refine"]}
if fault == "no_version":
    del ready["version"]
if fault == "other_protocol":
    ready["protocol"] = 99
if fault == "version_changes":
    note("starts", "one")
    with open(os.path.join(folder, "starts")) as file:
        ready["version"] = str(len(file.readlines()))
say(ready)

for number, line in enumerate(sys.stdin, 1):
    question = json.loads(line)
    answer = {"id": question["id"], "took_us": 1.0, "points": question["seeds"]}
    if number == 3:
        if fault == "edited":
            with open(__file__, "a") as file:
                file.write("# another algorithm\n")
        if fault in ("crash", "version_changes", "edited"):
            print("about to fail", file=sys.stderr, flush=True)
            os._exit(7)
        if fault == "killed":
            os.kill(os.getpid(), 9)
        if fault == "hang":
            time.sleep(300)
        if fault == "children":
            child_that_stays()
            child_that_stays(start_new_session=True)
            time.sleep(300)
        if fault == "crash_with_children":
            child_that_stays(start_new_session=True)
            os._exit(7)
        if fault == "hidden_child":
            # Without its mark, in a session of its own, and with all pipes: nobody ends it, and nobody waits for it.
            note("starts", "one")
            environment = {key: value for key, value in os.environ.items() if "CORNER" not in key}
            sleep = [sys.executable, "-c", "import time; time.sleep(6)"]
            subprocess.Popen(sleep, env=environment, start_new_session=True)
            os._exit(7)
        if fault == "no_newline":
            print(json.dumps(answer), end="", flush=True)
            time.sleep(300)
        if fault == "gigabyte":
            for _ in range(1 << 10):
                sys.stdout.write("x" * (1 << 20))
        if fault == "gigabyte_of_lines":
            for _ in range(1 << 14):
                sys.stdout.write(("y" * 1023 + "\n") * 64)
        if fault == "nan":
            answer["points"] = [[float("nan"), 2.0]]
        if fault == "infinity":
            answer["points"] = [[1.0, float("inf")]]
        if fault == "too_many":
            answer["points"] *= 2
        if fault == "too_few":
            answer["points"] = []
        if fault == "no_points":
            del answer["points"]
        if fault == "unknown_field":
            answer["confidence"] = 0.9
        if fault == "wrong_field":
            answer["responses"] = [1.0]
        if fault == "unknown_status":
            answer["statuses"] = ["fine"]
        if fault == "covariance":
            answer["covariances_px2"] = [[1.0, 3.0, 1.0]]
        if fault == "stray_output":
            print("loading model weights ...")
        if fault == "wrong_id":
            answer["id"] += 1
        if fault == "negative_time":
            answer["took_us"] = -1.0
        if fault == "impossible_time":
            answer["took_us"] = 1e12
        if fault == "says_so":
            answer = {"id": question["id"], "error": "ran out of memory"}
    say(answer)

if fault == "crash_at_exit":
    print("double free", file=sys.stderr, flush=True)
    os._exit(9)
