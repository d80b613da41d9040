"""Finding weights, with and without a network, and what is said when there are none."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from fnmatch import fnmatch

import pytest

from easyhecpp import _optional
from easyhecpp.errors import InputError, MissingExtraError
from easyhecpp.models import checkpoint
from easyhecpp.models.checkpoint import WeightsSpec, on_disk, preprocessor_settings
from easyhecpp.models.grounding_dino import GROUNDING_DINO
from easyhecpp.models.prompted import PromptedSegmenter
from easyhecpp.models.sam import SAM, load_sam
from easyhecpp.models.weights import fetch, offline, resolve

hub = pytest.importorskip("huggingface_hub", reason="needs the extra 'models'")

SPEC = SAM.weights
GATED = WeightsSpec("SAM 3", "facebook/sam3", ("sam3",), gated=True)
COMMIT = "0" * 40


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty Hugging Face cache, and a hub that must not be asked."""
    folder = tmp_path / "hub"
    monkeypatch.setattr(hub.constants, "HF_HUB_CACHE", str(folder))
    for switch in ("HF_HUB_OFFLINE", "TRANSFORMERS_OFFLINE"):
        monkeypatch.delenv(switch, raising=False)

    def no_network(*args, **kwargs):
        raise AssertionError("the network was used")

    monkeypatch.setattr(hub, "snapshot_download", no_network)
    return folder


def put_in_cache(cache, repo, files):
    """Lay files out as the hub's client does after a download."""
    entry = cache / f"models--{repo.replace('/', '--')}"
    snapshot = entry / "snapshots" / COMMIT
    snapshot.mkdir(parents=True, exist_ok=True)
    (entry / "refs").mkdir(exist_ok=True)
    (entry / "refs" / "main").write_text(COMMIT)
    for name, content in files.items():
        (snapshot / name).write_text(content)
    return snapshot


CONFIG = json.dumps({"model_type": "sam"})
WHOLE = {"config.json": CONFIG, "model.safetensors": "x"}


def test_a_folder_is_taken_as_it_is(tiny, cache, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    folder = tiny("sam")
    assert resolve(SPEC, folder) == folder
    assert resolve(SPEC, str(folder)) == folder
    assert load_sam(folder).name == "SAM (sam)"


def test_weights_in_the_cache_need_no_network(cache, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    assert on_disk(SPEC, SPEC.default) is None
    snapshot = put_in_cache(cache, SPEC.default, WHOLE)
    assert on_disk(SPEC, SPEC.default) == snapshot
    assert resolve(SPEC) == snapshot


def test_weights_in_several_files_count_when_all_are_there(cache):
    index = json.dumps({"weight_map": {"a": "one.safetensors", "b": "two.safetensors"}})
    files = {"config.json": CONFIG, "model.safetensors.index.json": index, "one.safetensors": "x"}
    put_in_cache(cache, SPEC.default, files)
    assert on_disk(SPEC, SPEC.default) is None
    snapshot = put_in_cache(cache, SPEC.default, {"two.safetensors": "x"})
    assert on_disk(SPEC, SPEC.default) == snapshot


def test_half_a_download_is_not_on_disk(cache):
    put_in_cache(cache, SPEC.default, {"config.json": CONFIG})
    assert on_disk(SPEC, SPEC.default) is None


@pytest.mark.parametrize("switch", ["HF_HUB_OFFLINE", "TRANSFORMERS_OFFLINE"])
@pytest.mark.parametrize("value", ["1", "true", "ON"])
def test_the_switches_are_honoured(cache, monkeypatch, switch, value):
    assert not offline()
    monkeypatch.setenv(switch, value)
    assert offline()
    with pytest.raises(InputError) as caught:
        resolve(SPEC)
    text = str(caught.value)
    assert "weights facebook/sam-vit-huge of SAM are not on this disk" in text
    assert "HF_HUB_OFFLINE" in text
    assert "hf download facebook/sam-vit-huge --include '*.json' --include '*.safetensors'" in text
    assert "--local-dir sam-vit-huge" in text
    assert "give it as --box-weights" in text
    assert "--segmenter classical" in text


def _http_error(kind):
    import httpx

    response = httpx.Response(403, request=httpx.Request("GET", "https://huggingface.co/x"))
    return kind("denied", response=response)


def _failures():
    import httpx

    yield hub.errors.LocalEntryNotFoundError("cannot reach the hub.\nmore"), "cannot reach the hub"
    yield ConnectionError(), "ConnectionError"
    yield OSError(28, "No space left on device"), r"\[Errno 28\] No space left on device"
    yield httpx.ProxyError("407 Proxy Authentication Required"), "407 Proxy Authentication Required"
    yield httpx.ReadTimeout(""), "ReadTimeout"
    for package, kind in (("httpx2", "ProxyError"), ("httpx2", "RemoteProtocolError")):
        try:
            yield getattr(__import__(package), kind)("torn"), "torn"
        except ImportError:  # the package of only some versions of the hub's client
            continue
    if hasattr(hub.errors, "XetDownloadError"):
        yield hub.errors.XetDownloadError("xet is down"), "xet is down"


@pytest.mark.parametrize(
    ("error", "reason"), list(_failures()), ids=lambda value: type(value).__name__
)
def test_a_download_that_fails_is_told_in_the_same_words(cache, monkeypatch, error, reason):
    def fail(name, **_):
        raise error

    monkeypatch.setattr(hub, "snapshot_download", fail)
    with pytest.raises(InputError) as caught:
        resolve(SPEC, "facebook/sam-vit-base")
    assert re.search(f"cannot be fetched: {reason}\\. .*classical", str(caught.value))
    assert "`hf download facebook/sam-vit-base --include" in str(caught.value)


def test_all_that_cannot_be_had_is_told_at_once(cache, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    mine = "lab/dino"
    put_in_cache(
        cache, mine, {**WHOLE, "config.json": json.dumps({"model_type": "grounding-dino"})}
    )
    with pytest.raises(InputError) as caught:
        fetch([(GROUNDING_DINO, mine), (SPEC, SPEC.default)])
    text = str(caught.value)
    assert "lab/dino of Grounding DINO (in the cache, but its tokenizer is missing" in text
    assert "and facebook/sam-vit-huge of SAM are not on this disk" in text
    assert "`hf download lab/dino --include '*.json'" in text
    assert "--include 'pytorch_model*.bin' --local-dir dino` and `hf download facebook/s" in text
    assert "copy the folders here and give them as --text-weights and --box-weights" in text


def test_weights_that_serve_two_models_are_named_once(cache, monkeypatch):
    from easyhecpp.models.sam3 import SAM3_BOXES, SAM3_TEXT

    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(InputError) as caught:
        fetch([(spec, "facebook/sam3") for spec in (SAM3_TEXT, SAM3_BOXES.weights)])
    assert str(caught.value).count("hf download") == 1
    assert "give it as --text-weights and --box-weights" in str(caught.value)


def test_gated_weights_are_called_gated(cache, monkeypatch):
    def denied(name, **_):
        raise _http_error(hub.errors.GatedRepoError)

    monkeypatch.setattr(hub, "snapshot_download", denied)
    with pytest.raises(InputError) as caught:
        resolve(GATED)
    text = str(caught.value)
    assert "weights facebook/sam3 of SAM 3 are gated" in text
    assert "https://huggingface.co/facebook/sam3, then `hf auth login`" in text
    assert "--segmenter classical" in text

    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(InputError, match="accept the licence on the model's page"):
        resolve(GATED)


def test_a_name_that_the_hub_does_not_know(cache, monkeypatch):
    def unknown(name, **_):
        raise _http_error(hub.errors.RepositoryNotFoundError)

    monkeypatch.setattr(hub, "snapshot_download", unknown)
    with pytest.raises(InputError, match=r"no model 'facebook/sam-vit-hug'.*check the spelling"):
        resolve(SPEC, "facebook/sam-vit-hug")


def test_a_download_fetches_no_second_copy_of_the_weights(cache, monkeypatch):
    asked = {}

    def download(name, **options):
        asked.update(name=name, **options)
        return str(put_in_cache(cache, name, WHOLE))

    monkeypatch.setattr(hub, "snapshot_download", download)
    assert resolve(SPEC).name == COMMIT
    assert asked["name"] == "facebook/sam-vit-huge"
    assert "*.safetensors" in asked["allow_patterns"]
    assert not any("bin" in p or ".pt" in p for p in asked["allow_patterns"])


def test_weights_that_exist_only_pickled_are_fetched(cache, monkeypatch):
    there = {"config.json": CONFIG, "pytorch_model.bin": "x", "training_args.bin": "x"}

    def download(name, allow_patterns):
        some = {f: c for f, c in there.items() if any(fnmatch(f, p) for p in allow_patterns)}
        return str(put_in_cache(cache, name, some))

    monkeypatch.setattr(hub, "snapshot_download", download)
    folder = resolve(SPEC, "lab/sam-tuned")
    assert sorted(p.name for p in folder.iterdir()) == ["config.json", "pytorch_model.bin"]

    there.pop("pytorch_model.bin")
    with pytest.raises(InputError) as caught:
        resolve(SPEC, "lab/sam-broken")
    assert "it has no model.safetensors" in str(caught.value)
    assert "hf download lab/sam-broken --include" in str(caught.value)
    assert "huge" not in str(caught.value)


@pytest.mark.parametrize("name", ["./weights", "/nowhere/sam", "~/none", "sam", "a/b/c"])
def test_a_folder_that_does_not_exist(cache, name):
    with pytest.raises(InputError, match=r"no folder .* with weights for SAM.*hf download"):
        resolve(SPEC, name)


def test_folders_that_are_no_checkpoint(tmp_path, tiny, cache):
    def complaint():
        with pytest.raises(InputError) as caught:
            resolve(SPEC, tmp_path)
        assert str(tmp_path) in str(caught.value)
        assert "--segmenter classical" in str(caught.value)
        return str(caught.value)

    assert "holds no checkpoint of SAM: it has no config.json" in complaint()
    (tmp_path / "config.json").write_text("[1, 2")
    assert "its config.json is not a JSON object" in complaint()
    (tmp_path / "config.json").write_text("[1, 2]")
    assert "its config.json is not a JSON object" in complaint()
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "bert"}))
    assert "names the model type 'bert', not 'sam'" in complaint()
    (tmp_path / "config.json").write_text(CONFIG)
    assert "it has no model.safetensors" in complaint()
    with pytest.raises(InputError, match="model type 'sam2', not 'sam'"):
        resolve(SPEC, tiny("sam2"))


def test_a_torn_checkpoint_is_not_run_with_random_numbers(tiny, tmp_path):
    safetensors = pytest.importorskip("safetensors.torch", reason="needs the extra 'models'")
    folder = tmp_path / "sam"
    shutil.copytree(tiny("sam"), folder)
    file = folder / "model.safetensors"
    tensors = safetensors.load_file(file)
    kept = {k: v for k, v in tensors.items() if not k.startswith("mask_decoder.transformer")}
    safetensors.save_file(kept, file, metadata={"format": "pt"})
    with pytest.raises(InputError, match=r"tensors are missing or misshapen, e\.g\. mask_decoder"):
        load_sam(folder)

    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(InputError, match="checkpoint of SAM cannot be loaded: "):
        load_sam(folder)


@pytest.mark.parametrize("file", ["preprocessor_config.json", "processor_config.json"])
def test_settings_are_found_where_old_and_new_versions_put_them(tmp_path, file):
    assert preprocessor_settings(tmp_path) == {}
    settings = {"image_mean": [0.1, 0.2, 0.3]}
    nested = {"image_processor": settings} if file.startswith("processor") else settings
    (tmp_path / file).write_text(json.dumps(nested))
    assert preprocessor_settings(tmp_path)["image_mean"] == [0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ('{"image_mean": "x"}', "its image_mean is 'x'"),
        ('{"image_mean": [0.5, 0.5]}', "its image_mean is "),
        ('{"image_std": [0.5, 0, 0.5]}', "its image_std is "),
        ('{"image_std": [0.5, null, 0.5]}', "its image_std is "),
        ('{"image_mean": [0.5', "it is not a JSON object"),
    ],
)
def test_broken_settings_are_said(tiny, tmp_path, content, reason):
    folder = tmp_path / "sam"
    shutil.copytree(tiny("sam"), folder)
    (folder / "preprocessor_config.json").write_text(content)
    with pytest.raises(InputError, match="settings of the image processor cannot") as caught:
        load_sam(folder)
    assert reason in str(caught.value)
    assert str(folder / "preprocessor_config.json") in str(caught.value)


@pytest.mark.parametrize("package", ["torch", "transformers"])
def test_a_missing_extra_is_said_with_its_pip_line(tiny, monkeypatch, package):
    folder = tiny("sam")
    real = _optional.importlib.import_module

    def without(name, *args):
        if name.partition(".")[0] == package:
            raise ModuleNotFoundError(f"No module named {package!r}", name=package)
        return real(name, *args)

    monkeypatch.setattr(_optional.importlib, "import_module", without)
    with pytest.raises(MissingExtraError, match=r'pip install "easyhecpp\[models\]"'):
        load_sam(folder)


def test_a_transformers_too_old_for_the_model_is_said(tiny):
    folder = tiny("sam")
    transformers = pytest.importorskip("transformers", reason="needs the extra 'models'")
    family = replace(SAM, class_name="Sam9Model")
    with pytest.raises(InputError) as caught:
        PromptedSegmenter(family, folder)
    assert f"transformers {transformers.__version__} cannot load SAM" in str(caught.value)
    assert 'pip install --upgrade "easyhecpp[models]"' in str(caught.value)


def test_without_the_extra_nothing_is_on_disk(monkeypatch):
    monkeypatch.setattr(checkpoint, "available", lambda module: False)
    assert on_disk(SPEC, "facebook/sam-vit-huge") is None
