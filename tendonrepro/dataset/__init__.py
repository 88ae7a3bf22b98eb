"""Measured data: the paper's, or any lab's, from files to traces.

=============  ==============================================================================================
`read`         files, folders and archives; a reader for each format gives tables of columns (`columns`)
readers        `text` and `workbook`, by `headers` and `cells`; `matlab` and HDF5, by `nested` and `simulink`;
               `labview`; `data_package`
`guess`        what columns are, by their names (`words`) and numbers; `suggestion` writes that as a mapping
`mapping`      the mapping, read and checked
`runs`         tables and a mapping become runs; `clocks` has their times, `digitised` curves read off figures
`ingestion`    what ``inspect`` and ``ingest`` do, of all these
`motion`       the desired motion behind runs; `windows` averages errors as the printed tables may have
`fetch`        the paper's record
=============  ==============================================================================================
"""
