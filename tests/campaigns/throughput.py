"""Throughput of two workers against one on the search phase: runs of the forward model per second of wall time.

    python tests/campaigns/throughput.py [--case CASE] [--set KEY=VALUE ...] [--workers 2] [--repeat 3] [--cluster local]
                                         [--search surrogate|direct] [--least 1.8]

The search alone: from workers that have started, compiled and made their models, to its end; the same runs each time, no ledger;
one thread for each process, this one too. `--search surrogate` (the default method: first runs, rounds of proof, rivals) or
`direct` (the genetic algorithm on the model, 8 people, 4 generations). One and more workers take turns, so that a load that
comes and goes harms both.

Needs a quiet machine: a scheduler that shares a loaded one between sessions gives two processes of one session no more than one;
`machine` is then 1, and the ratio means nothing. What does not depend on the load much, and says where a ratio below the number of
workers comes from:

- busy: share of the workers' time that is spent in runs; the rest is `tail` (at the end of a batch nothing is left to begin) and
  `between` (the search itself thinks, or the ledger writes);
- CPU seconds of a run: more with two workers than with one is memory or cache that they share, or cores that are half cores;
- machine: how much of a plain loop two processes get done against one: what no program can beat.

Exit code 1 below `--least` (1.8).
"""

import argparse
import multiprocessing
import os
import sys
import time
from pathlib import Path

for name in ("MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

CASE = Path(__file__).parents[2] / "cases" / "white_matter_2017" / "case.toml"
LOOPS = 20_000_000


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", type=Path, default=CASE)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--search", choices=["surrogate", "direct"], default="surrogate")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--cluster")
    parser.add_argument("--least", type=float, default=1.8)
    options = parser.parse_args()
    from indentfit.experiment.measured import read_case

    case = read_case(options.case, options.set)
    print(f"load before: {os.getloadavg()[0]:.2f}; machine: {machine(options.workers):.2f} times one process's loops", flush=True)
    rates: dict = {1: [], options.workers: []}
    shares: dict = {1: [], options.workers: []}
    for _ in range(options.repeat):
        for workers, cluster in ((1, None), (options.workers, options.cluster)):
            found = rate(case, options.search, workers, cluster)
            rates[workers].append(found[0])
            shares[workers].append(found[1])
    ratio = max(rates[options.workers]) / max(rates[1])
    each = ", ".join(f"{many / one:.2f}" for one, many in zip(rates[1], rates[options.workers], strict=True))
    print(f"{options.workers} workers reach {ratio:.2f} times the throughput of one, best of each; in turn {each}")
    busy = options.workers * max(shares[options.workers]) / max(shares[1])
    print(f"were it for the shares of busy time alone: {busy:.2f} times")
    print(f"load after: {os.getloadavg()[0]:.2f}")
    sys.exit(ratio < options.least)


def rate(case, search, workers, cluster):
    """Runs per second of a search on workers that have made their models already, and the share of their time in runs."""
    from indentfit.inverse import genetic
    from indentfit.inverse.exploration import explore
    from indentfit.inverse.problem import inverse_problem
    from indentfit.runs.pool import RunPool

    problem = inverse_problem(case)
    with RunPool(case, workers, cluster=cluster) as running:
        pool = timed(running)
        start = problem.at_reference(case.start_values())
        name = problem.searched[-1]
        pool.evaluate([{**start, name: start[name] * 1.01 ** (n + 1)} for n in range(workers)])  # all are ready; not of the search
        pool.known.clear()
        before, busy, cpu, pool.seconds_in = running.runs, running.seconds, cpu_seconds(running), 0.0
        started = time.perf_counter()
        if search == "direct":
            sizes = {"population": case.fit.population or 8, "generations": case.fit.generations or 4}
            genetic.search(problem, pool, case.fit.model_copy(update=sizes))
        else:
            explore(problem, pool, case.fit, genetic.search)
        seconds, runs = time.perf_counter() - started, running.runs - before
        busy, inside, cpu = running.seconds - busy, pool.seconds_in, cpu_seconds(running) - cpu
    shares = busy / workers / seconds, (inside - busy / workers) / seconds, (seconds - inside) / seconds
    of_run = f", {cpu / runs:.2f} CPU s a run" if cpu else ""
    print(
        f"{workers} workers: {runs} runs in {seconds:.1f} s, {runs / seconds:.3f} runs/s; "
        f"busy {shares[0]:.1%}, tail {shares[1]:.1%}, between {shares[2]:.1%}{of_run}",
        flush=True,
    )
    return runs / seconds, shares[0]


def cpu_seconds(pool):
    """CPU seconds of the processes that run: this one, or its local workers (Linux; else 0)."""
    workers = getattr(pool._workers, "_workers", None)
    if workers is None:
        return time.process_time() if pool.workers == 1 else 0.0
    try:
        stats = [Path(f"/proc/{worker.process.pid}/stat").read_text().rpartition(")")[2].split() for worker in workers]
    except OSError:
        return 0.0
    return sum(int(stat[11]) + int(stat[12]) for stat in stats) / os.sysconf("SC_CLK_TCK")


def machine(number):
    """How many times the plain loops of one process `number` processes get done in the same time."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(number) as pool:
        pool.map(loops, [1] * number)
        started = time.perf_counter()
        pool.apply(loops, [LOOPS])
        alone = time.perf_counter() - started
        started = time.perf_counter()
        pool.map(loops, [LOOPS] * number, chunksize=1)
        return number * alone / (time.perf_counter() - started)


def loops(number):
    total = 0
    for n in range(number):
        total += n & 3
    return total


def timed(workers):
    """A Watched pool that adds up how long it was asked, `seconds_in`."""
    from indentfit.inverse.exploration import Watched

    class Timed(Watched):
        seconds_in = 0.0

        def evaluate(self, points, report=None, sensitivities=()):
            started = time.perf_counter()
            try:
                return super().evaluate(points, report, sensitivities)
            finally:
                self.seconds_in += time.perf_counter() - started

    return Timed(workers)


if __name__ == "__main__":
    main()
