"""Protection levels of the fused solution, by solution separation.

| file           | what it holds |
|----------------|---------------|
| ``faults``     | the faults that are monitored, the probability of all others, rows without satellites |
| ``separation`` | a sub-filter for each fault, its separation from the solution, and the levels |
| ``alerts``     | the largest separation of each fault, and the suspects |
| ``live``       | the same for the streaming engine |
"""
