"""The toolbox of estimation, public but provisional: it may change in a minor version.

    filters  Kalman and particle filters, clusters, pose hypotheses, pose graphs
    paths    shortening of paths, segments against cells
    scans    rays, scan matching, likelihood fields, wall lines, loops by scans
    views    features, rigid motion, the place database, checks of a view
    survey   what a survey leaves: views, the corrected trajectory, the map
"""

__all__ = ["filters", "paths", "scans", "survey", "views"]
