from .answer_keys import Keyed as Keyed, Prompt as Prompt, prompted as prompted
from .assignments import assign as assign, assigned as assigned
from .bids import to_bids as to_bids
from .compare import (
    Coefficient as Coefficient,
    Effect as Effect,
    anova as anova,
    dunn as dunn,
    elapsed_times as elapsed_times,
    kruskal as kruskal,
    mixed as mixed,
    paired as paired,
    repeated as repeated,
    shapiro as shapiro,
    times_text as times_text,
)
from .cue_distances import (
    Distance as Distance,
    displayed as displayed,
    distances as distances,
    recorded as recorded,
)
from .designs import (
    ConstantStimuli as ConstantStimuli,
    Interleaved as Interleaved,
    Sequential as Sequential,
    Staircase as Staircase,
    shuffled as shuffled,
    turn_of as turn_of,
)
from .experiment import (
    Cursor as Cursor,
    Drawing as Drawing,
    Experiment as Experiment,
    Masking as Masking,
    Timing as Timing,
)
from .fit_comparison import LikelihoodRatio as LikelihoodRatio, likelihood_ratio as likelihood_ratio
from .fits import Fit as Fit, psychometric as psychometric, psychometrics as psychometrics
from .integration import Integrated as Integrated, integrated as integrated
from .intervals import bootstrap as bootstrap, profile as profile
from .latin_squares import (
    check_graeco_latin as check_graeco_latin,
    graeco_latin as graeco_latin,
    williams as williams,
)
from .likelihood import Estimate as Estimate
from .observers import (
    Listener as Listener,
    Power as Power,
    PsychometricObserver as PsychometricObserver,
    power as power,
    simulate as simulate,
)
from .presentation import (
    followed as followed,
    measured as measured,
    prepare as prepare,
    present as present,
    program as program,
    spans as spans,
)
from .quest import Quest as Quest
from .questions import (
    Question as Question,
    analogue as analogue,
    choice as choice,
    free_text as free_text,
    places as places,
    ranking as ranking,
    rating as rating,
)
from .random_streams import seed_of as seed_of, stream as stream
from .reader import (
    Saved as Saved,
    blinded as blinded,
    columns as columns,
    folder_of as folder_of,
    read as read,
    sessions as sessions,
    status as status,
)
from .report import write_report as write_report
from .runner import FrontEnd as FrontEnd, Simulated as Simulated, run as run
from .scaling import (
    Law as Law,
    bradley_terry as bradley_terry,
    fechner as fechner,
    jnd_from_dprime as jnd_from_dprime,
    line as line,
    stevens as stevens,
)
from .session import Session as Session
from .signal_detection import (
    Detection as Detection,
    ForcedChoice as ForcedChoice,
    Roc as Roc,
    detection as detection,
    diagnosis as diagnosis,
    forced_choice as forced_choice,
    roc as roc,
    wilson as wilson,
)
from .tables import (
    DifferenceThreshold as DifferenceThreshold,
    difference_thresholds as difference_thresholds,
    fitted as fitted,
    grouped as grouped,
    plain as plain,
    to_pandas as to_pandas,
)
from .tasks import (
    OneInterval as OneInterval,
    Rate as Rate,
    Roved as Roved,
    TwoInterval as TwoInterval,
)
from .texts import Texts as Texts, texts_of as texts_of
from .trial import (
    Answer as Answer,
    Record as Record,
    Stimulus as Stimulus,
    Trial as Trial,
    observed as observed,
    outcome as outcome,
)
