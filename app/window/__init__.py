"""Process 3: Qt. Paints rows and sends commands. No physics, no control law.

`windows` starts it: the `main_window`, whose pages (`home_page`, `try_page`, `run_page`, `analyse_page`) are each a
`page.Page`, and the `participant_window`. `painting.parts` has what pages are made of, `painting.theme` their look,
`painting.plane` what shows the handle; `plots` is every curve.
"""
