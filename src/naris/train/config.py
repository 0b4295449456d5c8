"""How a network is trained: settings, and the presets that the commands use."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from naris.core.cores import cores
from naris.errors import InputError
from naris.model.compact import CompactConfig
from naris.model.losses import COMPACT_LOSS, LossWeights
from naris.model.two_layer import TwoLayerConfig
from naris.train.augment import FEW_PICTURES, SEEN_AGAIN, Augmentation

Precision = Literal["float32", "bfloat16", "auto"]
_AHEAD = 2


@dataclass(frozen=True)
class Adam:
    """The optimiser (D. Kingma, J. Ba 2015).

    Attributes:
        learning_rate: at its highest.
        weight_decay: added to the gradient as in the original (L2), or taken off the weights if `decoupled`.
        decoupled: I. Loshchilov, F. Hutter 2019.
        cycle: let the learning rate rise over the first sixth and fall along a cosine (L. Smith 2018); else constant.
    """

    learning_rate: float = 1e-3
    weight_decay: float = 1e-3
    decoupled: bool = False
    cycle: bool = False


@dataclass(frozen=True)
class Muon:
    """The optimiser of the weights between a network's layers (`naris.train.optimiser`); Adam does the others.

    Attributes:
        learning_rate: at its highest, in Adam's measure; it rises and falls with Adam's.
        momentum: share of the past in the running mean of the gradient.
        weight_decay: taken off the weights.
    """

    learning_rate: float = 1e-2
    momentum: float = 0.95
    weight_decay: float = 0.05


@dataclass(frozen=True)
class Replay:
    """How views of a stream come back: rendering one may cost more than learning from it.

    Attributes:
        times: batches that a rendered batch's worth of views is used for, on average.
        memory: batches that are remembered; each training batch is drawn from these at random.
    """

    times: int = 3
    memory: int = 64


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides the weights, but for the data.

    Exactly one of `epochs`, `steps` and `budget_s` says how long.

    Attributes:
        name: of the preset, for reports.
        network: and its shape.
        seed: of the initial weights, the order of the pictures and their changes.
        batch: pictures a step.
        epochs: passes through a fixed set.
        steps: batches.
        budget_s: wall seconds of training; the learning rate follows the clock, so the result depends on the machine.
        adam: the optimiser.
        muon: another one for the inner weights of the compact network.
        average: decay a step of the running average of the weights that is kept in the end; 0 keeps the last weights.
        loss: of the compact network.
        augmentation: None shows pictures as they are.
        replay: of a stream; None shows every view once.
        frozen: first layers of the compact network (its stem, then its blocks) that stay as they began, which leaves
            more time for the others; for a training that starts from weights that know such pictures.
        strangers: share of a batch that is pictures of something else (compact network only).
        validation_share: of the trajectories of a fixed set that are kept apart to calibrate the network.
        precision: of the compact network's maps; `auto` is bfloat16 where the processor computes in it.
        threads: of torch meanwhile; None takes what `torch_threads` says.
        state_every_s: seconds between the states from which a killed run goes on.
    """

    name: str
    network: TwoLayerConfig | CompactConfig
    seed: int = 0
    batch: int = 64
    epochs: int | None = None
    steps: int | None = None
    budget_s: float | None = None
    adam: Adam = Adam()
    muon: Muon | None = None
    average: float = 0.0
    loss: LossWeights = COMPACT_LOSS
    augmentation: Augmentation | None = None
    replay: Replay | None = None
    frozen: int = 0
    strangers: float = 0.0
    validation_share: float = 0.0
    precision: Precision = "float32"
    threads: int | None = None
    state_every_s: float = 60.0

    def __post_init__(self) -> None:
        lengths = [length for length in (self.epochs, self.steps, self.budget_s) if length is not None]
        if len(lengths) != 1 or min(lengths) <= 0 or self.batch < 2:
            raise InputError(
                "one of epochs, steps and budget_s above 0, and a batch of 2 pictures or more",
                f"epochs {self.epochs}, steps {self.steps}, budget_s {self.budget_s}, batch {self.batch}",
                "correct the training settings",
            )
        layers = 1 + sum(self.network.blocks) if isinstance(self.network, CompactConfig) else 0
        if not 0 <= self.frozen <= layers:
            raise InputError(f"0 to {layers} frozen layers", f"{self.frozen}", "correct the training settings")

    def with_(self, **changes: Any) -> TrainConfig:
        """A copy with some settings replaced."""
        return replace(self, **changes)

    def lasting(
        self, *, epochs: int | None = None, steps: int | None = None, budget_s: float | None = None
    ) -> TrainConfig:
        """A copy that trains for so long."""
        return replace(self, epochs=epochs, steps=steps, budget_s=budget_s)

    @property
    def torch_threads(self) -> int:
        """Those that were asked for; else all cores for the two-layer network, and half of them for the compact one.

        The other half makes its lessons. A step of the compact network is many short pieces of work with a barrier
        after each, where threads that wait keep their cores busy: with more threads than free cores a picture costs
        ten times the CPU time.
        """
        return self.threads or (cores() if isinstance(self.network, TwoLayerConfig) else max(cores() // 2, 1))

    @property
    def lessons_ahead(self) -> int:
        """How many lessons are made beside a step: none where torch computes on every core.

        Threads of torch that wait for the one whose core makes lessons cost more than the lessons do.
        """
        return _AHEAD if self.torch_threads < cores() else 0

    @property
    def made_of(self) -> TrainConfig:
        """What decides the result: the settings without those that only say how the work is done."""
        return replace(self, threads=None, state_every_s=60.0)


PUBLISHED = TrainConfig(
    name="published",
    network=TwoLayerConfig(),
    batch=20,
    epochs=30,
    adam=Adam(learning_rate=1e-3, weight_decay=1e-3),
)
"""The two-layer network as in Sinha et al. 2018: raw pixels, Adam, batches of 20, 30 epochs, the last weights."""

COMPACT_FEW = TrainConfig(
    name="compact, few pictures",
    network=CompactConfig(),
    epochs=60,
    adam=Adam(learning_rate=3e-3, weight_decay=0.05, decoupled=True, cycle=True),
    muon=Muon(),
    average=0.995,
    augmentation=FEW_PICTURES,
    strangers=0.06,
    precision="auto",
)
"""The compact network on a fixed set of a thousand pictures or so."""

COMPACT_AT_WILL = TrainConfig(
    name="compact, views at will",
    network=CompactConfig(),
    steps=6000,
    adam=Adam(learning_rate=3e-3, weight_decay=0.05, decoupled=True, cycle=True),
    muon=Muon(),
    average=0.998,
    augmentation=SEEN_AGAIN,
    replay=Replay(),
    strangers=0.06,
    precision="auto",
)
"""The compact network on views that are rendered as it learns."""

COMPACT_ON = COMPACT_AT_WILL.with_(
    name="compact, views at will, from weights that know other noses",
    network=CompactConfig(input_px=96),
    adam=Adam(learning_rate=2e-3, weight_decay=0.05, decoupled=True, cycle=True),
    muon=Muon(learning_rate=2e-2 / 3),
    loss=replace(COMPACT_LOSS, label_smoothing=0.0),
)
"""The same from weights that know other noses (`naris.experiment.start_weights`), with lower rates to keep that.

The labels are hard: no view comes often enough to be learned by heart, and what softens a label in the middle of a
region also blurs where it ends.
"""

COMPACT_DEMO = COMPACT_AT_WILL.lasting(budget_s=140.0).with_(
    name="compact, demo",
    network=CompactConfig(input_px=96),
    adam=Adam(learning_rate=1e-3, weight_decay=0.05, decoupled=True, cycle=True),
    muon=Muon(learning_rate=3e-3),
    average=0.995,
    replay=Replay(times=8, memory=96),
    frozen=2,
)
"""The same in three to four minutes, from weights that know other noses (`naris.experiment.start_weights`).

Smaller pictures that are shown more often, and first layers that stay as they are, leave time for many more steps,
which is what so short a training lacks; lower rates keep what the weights know.
"""
