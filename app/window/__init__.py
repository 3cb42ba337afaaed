"""Process 3: Qt. Paints rows and sends commands. No physics, no control law; pages do not import each other.

`windows` starts it: the `main_window`, whose pages (`home`, `sandbox`, `run`, `analyse`) are `widgets.page.Page`s, and
the `participant` window. `canvas` draws the device, `widgets` has what all of them are made of.
"""
