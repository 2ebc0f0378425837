"""The trust campaign: does the filter know how wrong it is, in every situation and under every fault of a table?

    python -m tests.benchmarks.trust [--seeds N] [--first-seed S] [--rows a,b] [--workers W] [--output DIR]

| file          | what it holds |
|---------------|---------------|
| ``rows``      | what a row of the table is: a scenario, what spoils it, where it is looked at, what must hold |
| ``motions``   | scenarios in TOML |
| ``situations``, ``rates_and_gaps`` | the rows of situations |
| ``spoiling``  | what a fault does to the logs |
| ``faults``    | the rows of faults |
| ``lines``     | what must hold over several rows together |
| ``flying``    | one run: simulated and replayed in memory |
| ``measuring`` | what is kept of a run: numbers by name |
| ``scoring``   | bounds and verdicts |
| ``page``      | the page of results |

A check that is known to fail has its reason in ``expected`` of its row; when it passes, the page says so too.
"""
