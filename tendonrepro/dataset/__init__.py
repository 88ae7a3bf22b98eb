"""Measured data: the paper's, or any lab's, from files to traces.

=============  ==============================================================================================
`read`         files, folders and archives as `tables`; workbooks, LabVIEW, data packages
readers        `text`; `nested`, for MATLAB, HDF5 and TDMS
`guess`        what columns are, by their names (`words`) and numbers, as runs of a mapping
`mapping`      the mapping, read and checked
`runs`         tables and a mapping become runs, on the clocks of their columns
`ingestion`    what ``inspect`` and ``ingest`` do, of all these
`motion`       the desired motion behind runs; `windows` averages errors as the printed tables may have
`fetch`        the paper's record
=============  ==============================================================================================
"""
