"""The Home page: what to run, with which device and participant; the data; the editor of protocols."""
