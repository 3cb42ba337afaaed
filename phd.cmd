@echo off
rem The launcher on Windows: finds Python, sets the tree up on first use, then becomes the command phd (see app\set_up.py).
rem
rem   .\phd ...            set up where needed, then phd ... (see .\phd --help)
rem   .\phd test           ruff (rules, format), mypy, lint-imports, mkdocs, pytest (a part from a built wheel, a part without the jit)
rem   .\phd test ARGS      pytest ARGS only, from the top of the tree
rem
rem Exit 2: Python must be installed first; the message says what to type.
setlocal
set "start=%~dp0app\set_up.py"
set "venv=%~dp0.venv\Scripts\python.exe"
if not exist "%~dp0.venv\stamp-run" goto find
"%venv%" "%start%" %*
rem 75: what is installed is not what the files ask for. 103: the Python below the .venv is gone.
if "%errorlevel%"=="75" goto find
if "%errorlevel%"=="103" goto find
exit /b %errorlevel%

:find
set "suits=import sys; sys.exit(not ((3, 11) <= sys.version_info < (3, 14) and sys.maxsize > 2**32))"
set "python="
for %%p in ("py -3.13" "py -3.12" "py -3.11" "python" "python3") do if not defined python call :try %%~p
if defined python goto set_up
echo phd: no 64-bit Python 3.11, 3.12 or 3.13 found. Type: winget install Python.Python.3.13 >&2
exit /b 2

:set_up
%python% "%start%" %*
if not "%errorlevel%"=="0" exit /b %errorlevel%
"%venv%" "%start%" %*
exit /b %errorlevel%

:try
call %* -c "%suits%" >nul 2>nul
if "%errorlevel%"=="0" set "python=call %*"
exit /b 0
