"""Protection levels of the fused solution, by solution separation.

| file           | what it holds |
|----------------|---------------|
| ``faults``     | the faults that are looked at, and the rows without the satellites of one |
| ``separation`` | a sub-filter for each fault, its separation from the solution, levels and alerts |
"""
