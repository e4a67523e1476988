"""
A device that stands in for a GPU: its tensors are computed on the CPU, and it refuses what a GPU refuses, which are
operations with tensors of another device, generators of another device, and numpy.

:func:`main` trains on that device and prints what went wrong. It changes PyTorch for the whole process, and must be
imported there: classes of a program itself would be saved with all that they name, such as the device.
"""

from __future__ import annotations

import contextlib
import json
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch as th
from torch.utils._python_dispatch import TorchDispatchMode, return_and_correct_aliasing
from torch.utils._pytree import tree_leaves, tree_map
from torch.utils.backend_registration import _setup_privateuseone_for_python_backend

NAME = "standin"
aten = th.ops.aten
#: copies between devices, and indices, which may be on the CPU
MIXED = {
    *(aten.copy_.default, aten._to_copy.default, aten.set_.source_Tensor, aten.index.Tensor),
    *(aten.index_put.default, aten.index_put_.default, aten._index_put_impl_.default),
}
#: added to the seeds of generators on the device, by which an operation knows them
ITS_SEED = 2**50
Generator = th.Generator


class There(th.Tensor):
    """A tensor on the device."""

    content: th.Tensor

    @staticmethod
    def __new__(cls, inner: th.Tensor) -> There:
        layout: Any = {"strides": inner.stride(), "storage_offset": inner.storage_offset(), "dtype": inner.dtype}
        made: There = th.Tensor._make_wrapper_subclass(cls, inner.shape, **layout, device=th.device(NAME, 0))
        made.content = inner
        return made

    @classmethod
    def __torch_dispatch__(  # type: ignore[override]  # PyTorch's annotation is not that of a class method
        cls, func: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        return run(func, args, kwargs or {})

    # What PyTorch does for its own devices, and not for classes such as this one:

    def __repr__(self, **kwargs: Any) -> str:  # type: ignore[override]  # PyTorch's has no annotation
        return f"There({self.content!r})"

    def __format__(self, spec: str) -> str:
        return format(self.detach().cpu(), spec)

    def tolist(self) -> Any:
        return self.cpu().tolist()

    def numpy(self, *, force: bool = False) -> Any:
        if not force:
            raise TypeError(f"can't convert {NAME} tensor to numpy")
        return self.detach().cpu().numpy()

    def __getitem__(self, index: Any) -> th.Tensor:
        return super().__getitem__(without_lists(index))

    def __setitem__(self, index: Any, value: Any) -> None:
        super().__setitem__(without_lists(index), value)


def without_lists(index: Any) -> Any:
    parts = index if isinstance(index, tuple) else (index,)
    return tuple(th.tensor(part, dtype=th.long) if isinstance(part, list) else part for part in parts)


def is_there(device: Any) -> bool:
    return th.device(device).type == NAME


def run(func: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    """Any operation of PyTorch."""
    tensors = [each for each in tree_leaves((args, kwargs)) if isinstance(each, th.Tensor)]
    takes = any(isinstance(each, There) for each in tensors)
    # Numbers may be on the CPU.
    if takes and func not in MIXED and any(each.dim() and not isinstance(each, There) for each in tensors):
        raise RuntimeError(f"expected all tensors on the same device: {func}")
    gives, device = takes, kwargs.get("device")
    if device is not None:
        gives = is_there(device)
        kwargs = {**kwargs, "device": th.device("cpu")}
    generators = [each for each in (*args, *kwargs.values()) if isinstance(each, Generator)]
    if any((each.initial_seed() >= ITS_SEED) != gives for each in generators):
        raise RuntimeError(f"expected a generator of the same device: {func}")
    inner = tree_map(lambda each: each.content if isinstance(each, There) else each, (args, kwargs))
    results = func(*inner[0], **inner[1])
    if func is aten.copy_.default:
        return args[0]
    if not gives:
        return results
    results = tree_map(lambda each: There(each) if isinstance(each, th.Tensor) else each, results)
    return return_and_correct_aliasing(func, args, kwargs, results) if takes else results


class Dispatch(TorchDispatchMode):
    """Operations without a tensor of the device, such as those that make one."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]  # PyTorch's has no annotation

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return run(func, args, kwargs or {})


class EitherGenerator(Generator):
    """A generator that may be on the device."""

    offset: int

    def __new__(cls, device: Any = "cpu") -> EitherGenerator:
        made = super().__new__(cls)
        made.offset = ITS_SEED if is_there(device) else 0
        return made.manual_seed(0)

    def __init__(self, device: Any = "cpu") -> None:
        pass

    def manual_seed(self, seed: int) -> EitherGenerator:
        super().manual_seed(seed + self.offset)
        return self


def on_device(make: Callable[..., th.Tensor]) -> Callable[..., th.Tensor]:
    def made(data: Any, *args: Any, device: Any = None, **kwargs: Any) -> th.Tensor:
        result = make(data, *args, **kwargs) if not isinstance(data, There) else data
        return result if device is None else result.to(device=device, dtype=kwargs.get("dtype"))

    return made


def install() -> None:
    """Make the device known to PyTorch. These functions of its have no place for a class such as ours."""
    _setup_privateuseone_for_python_backend(NAME)
    th.__future__.set_swap_module_params_on_conversion(True)
    vars(th)["Generator"] = EitherGenerator
    th.as_tensor, th.tensor = on_device(th.as_tensor), on_device(th.tensor)
    # Inference mode knows no classes such as ours.
    plain: Any = contextlib.nullcontext
    vars(th)["inference_mode"] = lambda mode=True: (
        th.no_grad()(mode) if callable(mode) else th.no_grad() if mode else plain()
    )


def trainings() -> dict[str, Callable[[], Any]]:
    """What is trained on the device, by name."""
    from stable_baselines3 import PPO, SAC, TD3

    from helpers import imagination_env
    from sb3_hucrl import HUCRLCallback
    from sb3_hucrl.algorithms import HBPTT, HMPC, HMPO, HMVE, HSVG, MPO
    from sb3_hucrl.dynamics import LEARNED

    def training(kind: Any, env: dict[str, Any] | None = None, given: Any = None, **settings: Any) -> Callable[[], Any]:
        def train() -> Any:
            steps = 2 if kind is HMPC else 80
            small = {
                "batch_size": 16,
                "buffer_size": 1_000,
                "learning_starts": 40,
                "policy_kwargs": {"net_arch": [16]},
                "seed": 0,
            }
            kwargs = {**({} if kind is HMPC or kind is PPO else small), **(given or {})}
            policy = "NoPolicy" if kind is HMPC else "MlpPolicy"
            model = kind(policy, imagination_env(max_episode_steps=8, **(env or {})), device=NAME, **kwargs)
            ensemble = "ensemble" in settings.get("dynamics", "ensemble")
            learned = {"dynamics_kwargs": {"gradient_steps": 3, "net_arch": [8]}} if ensemble else {}
            short = {"imagined_steps": 40, "horizon": 5, "initial_steps": 8, "real_steps": 5, **learned}
            return model.learn(steps, callback=HUCRLCallback(**{**short, **settings}))

        return train

    plain = {"hallucinate": False}
    tsinf, theory = {"propagation": "tsinf"}, {"beta": "theory"}
    likely = {"optimize_hyperparameters": True, "recalibrate": True}
    many, few = {"horizon": 3, "num_particles": 60}, {"critic_updates": 2, "gradient_steps": 2}
    return {
        **{f"thompson {name}": training(SAC, plain, dynamics=name, exploration="thompson") for name in LEARNED},
        "tsinf": training(SAC, plain, exploration="greedy", exploration_kwargs=tsinf),
        "theory": training(SAC, dynamics="gp", dynamics_kwargs=likely, exploration_kwargs=theory),
        "bonus": training(SAC, plain, exploration="bonus", uncertainty_cap=2.0, sampling_fraction=0.0),
        "mixed replay": training(SAC, real_data_fraction=0.3, stale_fraction=0.2),
        "ppo": training(PPO, given={"n_steps": 20, "batch_size": 20}),
        "learned task": training(HSVG, {"hallucinated_dim": 3}, few, task="learned"),
        "steve": training(HMVE, given={"weighting": "steve"}),
        "HSVG": training(HSVG, given=few),
        **{kind.__name__: training(kind) for kind in (HBPTT, HMVE, MPO, HMPO, TD3)},
        **{name: training(HMPC, planner=name, planner_kwargs=many) for name in ("cem", "icem", "mppi")},
        "ilqr": training(HMPC, planner="ilqr", planner_kwargs={"horizon": 3, "num_iterations": 2}),
        "dyna-mpc": training(SAC, dyna_mpc={"horizon": 3}),
    }


def require_no_device(path: Path) -> None:
    """Networks are loaded to where they are needed, but other attributes of an algorithm to where they were."""
    import base64
    import zipfile

    data = json.loads(zipfile.ZipFile(path).read("data"))
    for name, value in data.items():
        if isinstance(value, dict) and ":serialized:" in value:
            pickled = base64.b64decode(value[":serialized:"])
            assert b"There\x94" not in pickled, name
            assert NAME.encode() not in pickled, name


def faults() -> dict[str, str]:
    """What went wrong, by name of the training."""
    from sb3_hucrl import export
    from sb3_hucrl.algorithms import HMPC

    found = {}
    with Dispatch(), tempfile.TemporaryDirectory() as folder:
        for name, train in trainings().items():
            try:
                model = train()
                assert is_there(model.hucrl.dynamics.device)
                model.save(Path(folder) / "model.zip")
                require_no_device(Path(folder) / "model.zip")
                if not isinstance(model, HMPC):
                    assert export(model, Path(folder) / "policy.zip").device.type == "cpu"
            except Exception:  # whatever it is, it is reported
                found[name] = traceback.format_exc()
    return found


def mistakes() -> list[str]:
    """What a GPU refuses, and this device does not."""
    accepted = []
    with Dispatch():
        values = th.ones(3, device=NAME)
        wrong: dict[str, Callable[[], Any]] = {
            "tensor on the CPU": lambda: values + th.ones(3),
            "generator on the CPU": lambda: th.randn(3, device=NAME, generator=th.Generator()),
            "generator on the device": lambda: th.randn(3, generator=th.Generator(NAME)),
            "numpy": lambda: values.numpy(),
        }
        for name, make in wrong.items():
            with contextlib.suppress(RuntimeError, TypeError):
                make()
                accepted.append(name)
    return accepted


def main() -> None:
    install()
    json.dump({"trainings": list(trainings()), "faults": faults(), "mistakes": mistakes()}, sys.stdout)
