"""Where a dataset is written: a folder, or a URL by way of a local folder.

Owns what the two have not in common. In both, unfinished work lies in ``.work``: a fingerprint, and for
every complete shard its record and its rows of the index.
"""

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from langwm_data import atomic
from langwm_data.claim import Kind, claim_output
from langwm_data.config import DatasetConfig
from langwm_data.config_io import CONFIG_FILE, ConfigError
from langwm_data.frames import BakeTask, RenderWorker
from langwm_data.plan import SPLITS, ShardTask
from langwm_data.remote import RemoteFolder, is_url
from langwm_data.scenes.assets import ASSETS_DIR
from langwm_data.shards.finish import Origin, finish_dataset, remove_work
from langwm_data.shards.manifest import CARD_FILE, FRAMES_FILE, MANIFEST_FILE, OBJECTS_FILE, ShardRecord
from langwm_data.shards.scenes import SCENES_DIR, read_scene, scene_file
from langwm_data.shards.writer import WORK_DIR, complete_shard, part_files, read_record, shard_path
from langwm_data.sim.render import describe_renderer
from langwm_data.workers import Report, WorkerFactory

FINGERPRINT_FILE = f"{WORK_DIR}/fingerprint"
_INDEX_DIR = str(Path(FRAMES_FILE).parent)
_KIND = Kind(writes=(MANIFEST_FILE, CARD_FILE, _INDEX_DIR, SCENES_DIR, ASSETS_DIR, WORK_DIR, *SPLITS))


class Output(Protocol):
    """What the pipeline asks of a place to write to."""

    folder: Path
    """Local, with config, manifest, scenes and unfinished work, but not always the shards."""

    def claim(self, config: DatasetConfig, *, fresh: bool) -> None:
        """Make it the place of this config, or refuse."""
        ...

    def announce(self) -> None:
        """Have everyone see the config and the fingerprint that stand in ``folder``."""
        ...

    def is_finished(self) -> bool:
        """Whether the manifest is there, by whomever it was written."""
        ...

    def discard_work(self) -> None:
        """Remove shards, scenes and records."""
        ...

    def remove_leftovers(self) -> None:
        """Remove what a finished dataset needs no more."""
        ...

    def complete_shards(self, tasks: Sequence[ShardTask], *, check_bytes: bool) -> list[ShardRecord]:
        """Records of those shards that are there whole."""
        ...

    def worker_factory(self, config: DatasetConfig) -> WorkerFactory:
        """Makes what bakes and renders for this output."""
        ...

    def finish(self, records: Sequence[ShardRecord], origin: Origin) -> None:
        """Make a dataset of all shards."""
        ...


@contextmanager
def open_output(out: str | Path, *, fresh: bool) -> Iterator[Output]:
    """The place that ``out`` names.

    Raises:
        ConfigError: If it is a URL that cannot be opened, or holds something else than a dataset.
    """
    if not is_url(out):
        yield LocalOutput(Path(out).absolute())
        return
    if fresh:
        raise ConfigError(f"--fresh removes no URL; remove {str(out)!r} yourself or give a new one")
    with tempfile.TemporaryDirectory(prefix="langwm-upload-") as folder:
        yield RemoteOutput(str(out), Path(folder) / "dataset")


class LocalOutput:
    """A folder, perhaps one that several machines share."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def claim(self, config: DatasetConfig, *, fresh: bool) -> None:
        """Make it the folder of this config, or refuse; ranges may do so at once."""
        claim_output(self.folder, config, _KIND, fresh=fresh, reads=config.scenes.folders)

    def announce(self) -> None:
        """Nothing to do: everyone reads the folder."""

    def is_finished(self) -> bool:
        """Whether the manifest is there, by whomever it was written."""
        return (self.folder / MANIFEST_FILE).is_file()

    def discard_work(self) -> None:
        """Remove shards, scenes and records."""
        for name in (WORK_DIR, SCENES_DIR, ASSETS_DIR, *SPLITS):
            shutil.rmtree(self.folder / name, ignore_errors=True)

    def remove_leftovers(self) -> None:
        """Remove what a finished dataset needs no more."""
        remove_work(self.folder)

    def complete_shards(self, tasks: Sequence[ShardTask], *, check_bytes: bool) -> list[ShardRecord]:
        """Records of those shards that are there whole; their bytes are compared where that is wanted."""
        look = complete_shard if check_bytes else read_record
        records = (look(self.folder, shard_path(task.split, task.number)) for task in tasks)
        return [record for record in records if record is not None]

    def worker_factory(self, config: DatasetConfig) -> WorkerFactory:
        """Makes what bakes and renders into this folder."""
        return partial(make_render_worker, config, self.folder, describe_renderer(config.render))

    def finish(self, records: Sequence[ShardRecord], origin: Origin) -> None:
        """Make a dataset of all shards."""
        finish_dataset(self.folder, records, origin)


class RemoteOutput:
    """A URL. What is small is kept in a local folder too; shards pass through the folders of workers."""

    def __init__(self, url: str, folder: Path) -> None:
        self.folder = folder
        self._remote = RemoteFolder(url)
        entries = self._remote.entries()
        if CONFIG_FILE not in entries and not all(atomic.is_temporary(e, CONFIG_FILE) for e in entries):
            raise ConfigError(f"--out {url!r} is not empty and holds no {CONFIG_FILE}; give a new one")
        self._pull("", suffix=CONFIG_FILE)
        self._pull(SCENES_DIR)
        self._pull(WORK_DIR, suffix=FINGERPRINT_FILE)

    def claim(self, config: DatasetConfig, *, fresh: bool) -> None:
        """Make it the place of this config, or refuse."""
        try:
            # --fresh removes no URL, so it must not be offered either.
            claim_output(self.folder, config, _KIND, fresh=fresh, reads=[self.folder])
        except ConfigError as error:
            raise ConfigError(str(error).replace(str(self.folder), self._remote.url)) from None

    def announce(self) -> None:
        """Upload the config and the fingerprint."""
        self._remote.put(self.folder, CONFIG_FILE)
        self._remote.put(self.folder, FINGERPRINT_FILE)

    def is_finished(self) -> bool:
        """Whether the manifest is there, by whomever it was written."""
        return MANIFEST_FILE in self._remote.names()

    def discard_work(self) -> None:
        """Remove shards, scenes and records, here and there."""
        LocalOutput(self.folder).discard_work()
        for name in (WORK_DIR, SCENES_DIR, ASSETS_DIR, *SPLITS):
            self._remote.remove(name)

    def remove_leftovers(self) -> None:
        """Remove what a finished dataset needs no more."""
        self._remote.remove(WORK_DIR)
        for folder in ("", _INDEX_DIR, SCENES_DIR, ASSETS_DIR, *SPLITS):
            for name in self._remote.names(folder):
                if Path(name).name.startswith(".") and name.endswith(".tmp"):
                    self._remote.remove(name)

    def complete_shards(self, tasks: Sequence[ShardTask], *, check_bytes: bool) -> list[ShardRecord]:
        """Records of those shards that are there with the right size; nothing is downloaded to compare."""
        self._pull(WORK_DIR, suffix=".json")
        sizes = {name: size for split in SPLITS for name, size in self._remote.names(split).items()}
        paths = [shard_path(task.split, task.number) for task in tasks]
        records = [read_record(self.folder, path, size=sizes.get(path)) for path in paths]
        return [record for record in records if record is not None]

    def worker_factory(self, config: DatasetConfig) -> WorkerFactory:
        """Makes what bakes and renders, and uploads what came of it."""
        return partial(UploadingWorker, config, self._remote.url, describe_renderer(config.render))

    def finish(self, records: Sequence[ShardRecord], origin: Origin) -> None:
        """Make a dataset of all shards; the manifest arrives last."""
        self._pull(WORK_DIR)
        self._pull(SCENES_DIR)
        finish_dataset(self.folder, records, origin)
        for name in (FRAMES_FILE, OBJECTS_FILE, CARD_FILE, MANIFEST_FILE):
            self._remote.put(self.folder, name)
        self.remove_leftovers()

    def _pull(self, folder: str, suffix: str = "") -> None:
        for name in self._remote.names(folder):
            if name.endswith(suffix) and not name.endswith(".tmp") and not (self.folder / name).is_file():
                self._remote.get(name, self.folder)


class UploadingWorker:
    """A ``RenderWorker`` with a folder of its own, whose shards and scenes are uploaded and then removed."""

    def __init__(self, config: DatasetConfig, url: str, renderer: str) -> None:
        self._remote = RemoteFolder(url)
        self._held = ExitStack()
        self._folder = Path(self._held.enter_context(tempfile.TemporaryDirectory(prefix="langwm-upload-")))
        self._make: Callable[[], RenderWorker] = partial(make_render_worker, config, self._folder, renderer)

    def __enter__(self) -> Self:
        self._worker = self._held.enter_context(self._make())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._held.close()

    def __call__(self, task: BakeTask | ShardTask, report: Report) -> None:
        """Do one task; a shard's record arrives after its bytes and its rows of the index."""
        if isinstance(task, BakeTask):
            self._worker(task, report)
            for file in read_scene(self._folder, task.scene).assets():
                self._remote.put(self._folder, f"{ASSETS_DIR}/{file}")
            self._remote.put(self._folder, scene_file(task.scene))
            return
        for folder in (SCENES_DIR, ASSETS_DIR):
            for name in self._remote.names(folder):
                if not name.endswith(".tmp") and not (self._folder / name).is_file():
                    self._remote.get(name, self._folder)
        self._worker(task, report)
        path = shard_path(task.split, task.number)
        for name in (path, *part_files(path)):
            self._remote.put(self._folder, name)
            (self._folder / name).unlink()


def make_render_worker(config: DatasetConfig, folder: Path, renderer: str) -> RenderWorker:
    """A worker that draws with ``renderer``, as the fingerprint says that all of them do.

    Raises:
        ConfigError: If the machine on which this is called draws with something else.
    """
    here = describe_renderer(config.render)
    if here != renderer:
        raise ConfigError(f"a machine of the cluster draws with {here!r}; all must draw with {renderer!r}")
    return RenderWorker(config, folder)
