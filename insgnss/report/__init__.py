"""Reports: the page of a run, comparisons of runs, files for maps, figures for papers.

::

    from insgnss.report.page import write_report          # run.report("page.html") does the same
    from insgnss.report.compare import compare_runs
    from insgnss.report.export import export_run          # KML, GPX, RTKLIB, NMEA, SBET, MATLAB, NetCDF, ...
    from insgnss.report.netcdf import as_dataset          # the run as an xarray data set
    from insgnss.report import figures                    # matplotlib, loaded when a figure is drawn
"""
