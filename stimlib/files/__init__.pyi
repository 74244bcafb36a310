from .audio import (
    as_scene as as_scene,
    read as read,
    save as save,
    write as write,
    write_frames as write_frames,
)
from .log_reader import MotionFile as MotionFile, SessionLog as SessionLog, read_log as read_log
from .log_replay import Replay as Replay, replay as replay
from .log_writer import LogWriter as LogWriter, header as header
from .pattern_table import PatternDevice as PatternDevice
from .patterns import (
    ImportedPattern as ImportedPattern,
    PatternReport as PatternReport,
    read_pattern as read_pattern,
    write_pattern as write_pattern,
)
from .sidecar import FileReport as FileReport
