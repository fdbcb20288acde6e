"""The toolbox of estimation, public but provisional: filters, scans, views."""
