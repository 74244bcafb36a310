"""Looking at signals and scenes: spectra, cues, the AM model, graphs, pictures, copies
for ears.
"""
