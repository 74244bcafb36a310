"""Is what was rendered or displayed what the model says?"""
