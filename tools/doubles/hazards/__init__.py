"""What people really bring to the solver: seeded scenes of every kind of trouble, healthy ones among them.

`kinds.KINDS` is the one table of them. A kind is a function from a random generator to a scene, with what is wrong in
it and whose fault that is, so that an answer can be judged without looking: `python -m tools.bench.solve_hazards`.
"""
