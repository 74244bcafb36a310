"""What drives the inputs: functions of time, recordings, samples."""
