"""Speed and memory of the correctors on this machine: measured and printed, never judged.

| module | contents |
|---|---|
| `frames` | `FrameLoop`: the frames that every measurement plays, in memory or as files |
| `timings` | latency of both correctors, per frame and per step |
| `libraries` | times of the paper's image operations by library |
| `throughput` | frames per second from files |
| `memory` | peak memory of a corrector |
| `suite`, `report` | the benchmark as a whole, and its printed tables |
"""
