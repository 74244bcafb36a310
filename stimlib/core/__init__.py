"""What everything stands on: graph, units, arithmetic, steps, program, scene, response;
limits; files of others.
"""
