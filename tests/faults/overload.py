"""More pictures are asked for than the machine can draw: 200 clients ask for four times as many (C7).

What it draws must stay at 90 % of what it draws at its best, and the rest must learn at once (503 within 50 ms) when to come again: `Retry-After` is
about as long as those wait who are served.
"""

import http.client
import itertools
import statistics
import threading
import time

from attack import Report, Server, Watch, head, is_short

CLIENTS = 200
SECONDS = 8 if is_short() else 20


def asked(server, case, number):
    """The status of a picture that nobody asked for before, how long the answer took, and `Retry-After`."""
    began = time.monotonic()
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    try:
        depth = 1 + (number * 7919 % 7001) / 1000
        connection.request("GET", f"{case}/render?depth_mm={depth}&width=256&height=256&view=left")
        answer = connection.getresponse()
        answer.read()
        return answer.status, time.monotonic() - began, answer.headers.get("retry-after")
    finally:
        connection.close()


def load(server, case, numbers, clients, every_s):
    """The answers to clients that ask again as soon as they have an answer, and not more often than every so many seconds."""
    answers, end = [], time.monotonic() + SECONDS

    def client(number):
        next_at = time.monotonic() + every_s * number / clients
        while True:
            time.sleep(max(0.0, min(next_at, end) - time.monotonic()))
            if time.monotonic() >= end:
                return
            answers.append(asked(server, case, next(numbers)))
            next_at = max(next_at + every_s, time.monotonic() - every_s)

    threads = [threading.Thread(target=client, args=(number,)) for number in range(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return answers


def drawn_each_second(answers):
    return sum(status == 200 for status, *_ in answers) / SECONDS


def main():
    report = Report("four times as many pictures as can be drawn")
    with Server() as server:
        case = server.prepared(head(4.0))
        numbers = itertools.count()
        load(server, case, numbers, 2, 0.0)
        best = max(drawn_each_second(load(server, case, numbers, clients, 0.0)) for clients in (2, 4, 8))
        report.figure("at its best", f"{best:.1f} pictures a second")
        with Watch(server) as watch:
            answers = load(server, case, numbers, CLIENTS, CLIENTS / (4 * best))
        drawn = drawn_each_second(answers)
        served = sorted(took for status, took, _ in answers if status == 200)
        refused = sorted(took for status, took, _ in answers if status == 503)
        others = {status for status, *_ in answers} - {200, 503}
        waits = [int(wait) for status, _, wait in answers if status == 503 and wait]
        report.figure("asked for", f"{len(answers) / SECONDS:.1f} pictures a second")
        report.target("goodput at four times the load (C7)", "90 % of the best", f"{100 * drawn / best:.0f} %", drawn >= 0.9 * best, binds=False)
        report.expect("nothing but pictures and 503", not others, others)
        if refused:
            slow = refused[int(0.99 * (len(refused) - 1))]
            report.target("503 (C7)", "within 50 ms", f"99 % within {1000 * slow:.0f} ms, half within {1000 * statistics.median(refused):.0f} ms",
                          slow <= 0.05, binds=False)
            report.expect("every 503 says when to come again", len(waits) == len(refused))
            report.target("Retry-After (C7)", "as long as those wait who are served", f"{statistics.median(waits)} s; they wait {statistics.median(served):.1f} s",
                          abs(statistics.median(waits) - statistics.median(served)) <= 1.0, binds=False)
        watch.tell(report)
        report.expect("health never fails", watch.failed == 0)
    report.end()


main()
