"""Process 3: Qt. Paints rows and sends commands. No physics, no control law; pages do not import each other.

`program` starts it; `windows` are the `main_window`, whose pages (`home`, `sandbox`, `run`, `analyse`, `device`) are
`widgets.page.Page`s, and the `participant` window. `canvas` draws the device, `widgets` has what all are made of.
"""
