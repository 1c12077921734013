"""The loop of strike, filming, identification and planning until a hit: an adapter plans, a port strikes and films."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from whiptool.adaptation.adapter import Adapter, Options
from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.prior import Belief
from whiptool.adaptation.steps import Port, Seen, Step, Steps, checked
from whiptool.adaptation.twins import Twin
from whiptool.errors import InputError, expect
from whiptool.goals.target import Target, as_target
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.stops import STOPPED, Interlock, StrikeStopped


@dataclass
class Adaptation:
    """A run that strikes with an unknown whip, identifies it from each recording, and plans the next strike, until a
    hit.

    Args:
        prior: Prior of the whip's parameters before the first strike.
        port: Simulated whip, rig or your robot, which strikes and films.
        target: Point to hit, and hit radius.
        options: See `Options`.
        folder: Run folder; None: nothing is written.
        recordings: Earlier recordings of the same whip, from which the first strike is planned.
        known: Posterior after those recordings, if it was computed before; None: it is computed.
        opening: Plan of the first strike, if it was computed before; None: it is computed.
        interlock: Interlock that is set after a stop; default: that of the rig, if the port has one. A stop is recorded
            in the folder.

    Raises:
        InputError: An argument has a wrong type, or target, prior and port are inconsistent: the port has another
            target, or its twin another arm than the prior.
    """

    prior: Belief
    port: Port
    target: Target
    options: Options = field(default_factory=Options)
    folder: Path | None = None
    recordings: list[StrikeRecording] = field(default_factory=list)
    known: Belief | None = None
    opening: Plan | None = None
    interlock: Interlock = field(default_factory=Interlock)

    def __post_init__(self) -> None:
        expect(Belief, prior=self.prior)
        expect(Target, target=self.target)
        expect(Options, options=self.options)
        if not callable(getattr(self.port, "strike", None)):
            raise InputError(
                "port", type(self.port).__name__, "an object with the methods of a Port, such as a TipPort or a RigPort"
            )
        self._check_together()

    def _check_together(self) -> None:
        """Refuse a target or a port that is of another arm than the belief, and a port that aims elsewhere."""
        model = self.prior.at().model
        self.target.check_fits(model)
        twin, aimed = getattr(self.port, "twin", None), getattr(self.port, "target", None)
        if isinstance(twin, Twin) and twin.model.arm.joints != model.arm.joints:
            given, rule = ", ".join(twin.model.arm.joints), f"a twin of the prior's arm: {', '.join(model.arm.joints)}"
            raise InputError("port", f"a twin whose joints are {given}", rule)
        if aimed is not None and as_target(aimed).position != self.target.position:
            rule = f"{as_target(aimed).position}, which the port aims at"
            raise InputError("target", self.target.position, rule, "give both the same")

    def adapter(self) -> Adapter:
        """Return the `Adapter`, which plans the strikes and identifies the whip, without the port.

        Strikes that the port would refuse are not planned; `options.check` replaces the port's own judgement.
        """
        options = self.options
        if options.check is None:
            options = replace(options, check=getattr(self.port, "refusal", None))
        return Adapter(
            self.prior,
            self.target,
            options,
            self.folder,
            recordings=self.recordings,
            known=self.known,
            opening=self.opening,
        )

    def run(self, on_step: Callable[[Step], None] = lambda step: None) -> Steps:
        """Strike until a hit is claimed, see `Step.hit`, or until the largest number of strikes.

        Strikes of an earlier run in the folder are read and not repeated. A strike is repeated if the process was
        killed before its outcome was written, or if a fault or a signal ended it; it does not count. After a fault a
        person has to call `interlock.release()` before the next strike.

        Args:
            on_step: Called with every step as soon as it is complete.

        Returns:
            All steps, including the measurement before the first strike.

        Raises:
            StrikeStopped: A fault interrupted a strike, from which nothing was learned.
            KeyboardInterrupt: A signal came.
            NoPlan: No strike was found that may be made; those made before are kept.
            Locked: The session was stopped before, and no person has released it.
            InputError: The folder is damaged.
        """
        if self.folder is not None:
            self.interlock.watch(self.folder / STOPPED)
        self.interlock.check()
        adapter = self.adapter()
        for step in adapter.kept_steps():
            on_step(step)
        while (strike := adapter.ask()) is not None:
            if adapter.place is not None:
                adapter.place.mkdir(parents=True, exist_ok=True)
            must_teach = getattr(self.port, "must_teach", False)
            on_step(adapter.tell(self._struck(strike, adapter), must_teach=must_teach))
        return adapter.steps

    def _struck(self, strike: Strike, adapter: Adapter) -> Seen:
        """Return what the port saw of a strike that was carried out or refused; raise StrikeStopped if it was
        interrupted.
        """
        try:
            seen = self.port.strike(strike, adapter.number, adapter.place, adapter.belief.at().model)
            if isinstance(seen, Seen) and seen.fault:
                raise StrikeStopped(seen.fault)
        except StrikeStopped as stopped:
            self.interlock.trip(stopped.reason, torque=stopped.torque)
            raise
        return checked(seen, strike, adapter.number)
