"""Many mesh files at once: read, solved, written, on one machine or a cluster, with faults that cost only their file.

Four kinds of processes take part. The driver lists the inputs and hands them out (`engine`); it solves nothing, and
archives are listed for it by a process of their own (`archives`). Each worker of a Dask cluster keeps a process that
solves (`worker`), and ends it where a file takes too long or too much memory. That process (`solver`) reads, solves and
writes.
"""
