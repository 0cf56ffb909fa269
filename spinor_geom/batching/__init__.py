"""Fills many mesh files, on one machine or a cluster. A file that crashes its process does not affect the others.

`engine` lists the sources (`inputs`, `archives`) and submits blocks of them to the `workers`. Each worker controls a
process (`solver`) that reads the files, solves their loops (`task`) and writes the results (`store`). At the end
`summary` writes a table and a page.
"""
