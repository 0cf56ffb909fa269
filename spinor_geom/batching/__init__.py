"""Many mesh files at once: read, solved, written, on one machine or a cluster, with faults that cost only their file.

The driver lists the inputs and hands them out (`engine`). It solves nothing; a process of its own lists archives for it
(`archives`). Each worker, a thread of the driver or of a Dask cluster, keeps a process that solves, and ends it where a
file takes too long or too much memory (`worker`). That process reads, solves and writes (`solver`).
"""
