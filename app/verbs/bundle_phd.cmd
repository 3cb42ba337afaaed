@echo off
rem Starts phd; words after it are its arguments: phd study --operators 1 --out results
setlocal
set "PYTHONHOME="
set "PYTHONPATH="
"%~dp0python\python.exe" -m app.cli %*
