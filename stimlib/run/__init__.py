"""What a scene becomes, and how it is driven: processor, rendering, the safety
stage.
"""
