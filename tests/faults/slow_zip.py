"""One slow DICOM upload holds the others up.

A zip of 19,999 files of one byte, again and again from one address, while another client sends a small series. The
other client must get its answer within 5 s.
"""

import json
import threading
import time

from attack import FORM, Report, Server, form, zip_of


def main():
    report = Report("a slow zip")
    slow = zip_of((str(number), b"x") for number in range(19_999))
    small = zip_of([("1.dcm", bytes(128) + b"DICM" + bytes(64))])
    many_parts = form([("dicom", b"x")] * 19_999)
    with Server() as server:
        for name, body in [("a zip", form([("volume", slow)])), ("parts", many_parts)]:
            started = time.monotonic()
            answers = []

            def attack():
                answers.append(server.ask("POST", "/v1/cases", body, {"Content-Type": FORM}, 120)[0])

            threads = [threading.Thread(target=attack) for _ in range(4)]
            for thread in threads:
                thread.start()
            waited, seen = 0.0, set()
            while any(thread.is_alive() for thread in threads):
                begun = time.monotonic()
                status, _, answer = server.ask(
                    "POST", "/v1/cases", form([("volume", small)]), {"Content-Type": FORM}, 120, source="127.0.0.7"
                )
                waited = max(waited, time.monotonic() - begun)
                seen.add((status, json.loads(answer).get("type", "").rsplit(":", 1)[-1] if status else "no answer"))
                time.sleep(0.2)
            report.figure(name, f"four of 19,999 files took {time.monotonic() - started:.1f} s: {answers}")
            report.figure("the other client", f"{sorted(seen)}, at most {waited:.1f} s")
            refused = all(status in (415, 422) for status, _ in seen)
            report.expect(f"{name}: the other client waits for less than 5 s", waited < 5 and refused)
    report.end()


main()
