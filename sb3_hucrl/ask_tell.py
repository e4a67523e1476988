"""The outer loop of H-UCRL around a real system that is elsewhere: another process, a robot, a cluster."""

from __future__ import annotations

from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.callbacks import HUCRLCallback
from sb3_hucrl.checks import Location, validated
from sb3_hucrl.loop import AskedPolicy, Episode, Report
from sb3_hucrl.products import FastProducts
from sb3_hucrl.sb3 import (
    Checkpoint,
    TrainingLog,
    begin_logger,
    find_imagination,
    make_loop,
    make_search,
    save_atomically,
    search_policy,
)


@validated
class AskTell:
    """
    Searches policies in imagination, as ``model.learn(..., callback=HUCRLCallback(...))`` does, and leaves it to the
    caller to play the real episodes::

        optimizer = AskTell(model, HUCRLCallback(max_real_steps=2_000))
        while not optimizer.finished:
            policy = optimizer.ask()  # random at first; later the result of a search
            episode = policy.play(real_env)  # anywhere; or call policy.act(observation) and build an Episode
            optimizer.tell(episode)

    The environments of the model are never stepped; where there are none, :class:`sb3_hucrl.RemoteEnv` stands for them.
    Several real systems can play at once: call :meth:`ask` for each of their episodes, and tell them in any order.

    With ``HUCRLCallback(checkpoint=...)`` each call saves all that is known before it returns: an episode is recorded
    once, however often it is told, whenever the process is killed. To go on, load the zip file with ``env``, and make
    an AskTell of it.

    :param model: SB3 algorithm with an :class:`sb3_hucrl.ImaginationVecEnv`
    :param callback: holds the settings; it needs ``max_real_steps``, by which the run is planned and ends, and takes no
        ``real_envs``
    :raises ValueError: if model, environment and settings do not fit together
    """

    def __init__(self, model: BaseAlgorithm, callback: HUCRLCallback) -> None:
        env = model.get_env()
        if env is None:
            raise ValueError("the model has no environment: load it with env=ImaginationVecEnv(vec_env)")
        self._env = find_imagination(env)
        #: the SB3 algorithm; its policy is that of the latest search
        self.model = model
        begin_logger(model)
        hooks, verbose = (self._save, self._on_refit), callback.given_verbose
        self._loop = make_loop(model, self._env, callback.settings, callback.transitions, *hooks, verbose, told=True)
        self._search = make_search(model, self._env, self._loop)
        self._file, self._log = Checkpoint(model, callback.checkpoint), TrainingLog()
        self._log.begin(model, self._loop, self._search, callback.log_dir, verbose)

    @property
    def finished(self) -> bool:
        """Whether real episodes have reached the ``max_real_steps``, or the ``reward_threshold``."""
        return self._loop.finished

    def ask(self) -> AskedPolicy:
        """
        A policy for the next real episode. If enough episodes were told since the last search, this fits the model and
        searches, which may take minutes; otherwise it returns at once. Ctrl-C interrupts a search, and the next call
        goes on with it.

        :return: for one episode; it can be pickled
        :raises ValueError: if the policy cannot be pickled
        :raises OSError: if the checkpoint cannot be written
        """
        if self._loop.needs_search:
            products = FastProducts(self.model.device)
            try:
                search_policy(self._search, self._loop, self._env.num_envs)
                policy = self._loop.ask(self._search)
            finally:
                self._env.real()
                products.end()
        else:
            policy = self._loop.ask()
        self._save()
        return policy

    def tell(self, episode: Episode) -> bool:
        """
        Record a real episode. It is checked as real episodes of a training are.

        :param episode: of a policy from :meth:`ask`, or of another one, such as a demonstration
        :return: whether it is new; False if it was told before, which changes nothing
        :raises ValueError: if it is not what a real episode must be, or another episode was told under its policy's id
        :raises OSError: if the checkpoint cannot be written: tell it again
        """
        return self._loop.tell(episode)

    @validated
    def save(self, path: Location) -> None:
        """
        :param path: of the model's zip file, which is replaced in one step
        :raises OSError: if it cannot be written; what was there is left as it was
        """
        save_atomically(self.model, Path(path))

    def close(self) -> None:
        """Close the log, and let other processes write the checkpoint."""
        self._log.end()
        self._file.end()

    def _on_refit(self, report: Report) -> None:
        self._log.record(report)
        self._save()

    def _save(self) -> None:
        self._file.save()
