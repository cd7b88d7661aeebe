"""Tests that each mistake gets one line saying what is wrong and what to type, and that other output is plain."""

import logging
import re
import sys
from io import BytesIO, StringIO, TextIOWrapper
from pathlib import Path

import pytest
from hydra.errors import CompactHydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from program import ended
from refusals import refuses

from brushexp.bounds import above, at_least, between, multiple_of, one_of
from brushexp.cli.help import help_text, words_and_topic
from brushexp.cli.opening import open_with, opening_line
from brushexp.cli.program import expand_arguments, settings_first
from brushexp.config.check import check
from brushexp.config.key_types import type_of_key
from brushexp.config.keys import keys_of
from brushexp.config.mistakes import explanation
from brushexp.config.tasks import TASKS
from brushexp.errors import UserError
from brushexp.runs.run_folder import take_name, warn_of_launcher
from brushexp.system.progress import showing
from brushexp.system.terminal import IN_LOG, Terminal, as_shown
from brushexp.system.words import conf_folders

ROOT = Path(__file__).parents[1]
MISTAKES = {
    # words, keys and choices
    "outputs/x/catalogue.h5": "or PICTURE catalogue=outputs/x/catalogue.h5 to continue from its strokes",
    "nonsense": "is not a file, a task or key=value; brushexp --help lists looks, tasks and keys",
    "watercolur": "is not a file, a task or key=value; did you mean watercolour",
    "docs/image/": "docs/image/ is not a file, a task or key=value; did you mean docs/images/?",
    "nofolder/": "nofolder/ is not a file, a task or key=value; correct the path",
    "WaterColor": "did you mean watercolour",
    "overwrite": "overwrite is a key; type overwrite=true, without spaces (whether",
    "-o": "-o is not a flag; --help lists the keys, which have no dashes",
    "~/not/there.jpg": "image=~/not/there.jpg is not there",
    "docs/images/BRUSHIFY.JPG": "is not there; did you mean docs/images/brushify.jpg",
    "https://example.com/a.jpg": "is a web address; download the picture and give the path of the file",
    "light=off": "try light=315,45, or light.depth=0 for none",
    "to=pdf": "drop to=pdf, and after painting, type: brushexp export FOLDER to=pdf",
    "image=clip.mp4 to=gif": "after painting, type: brushexp export FOLDER/frames/000000.h5 to=process",
    "look=tubes to=plan": "after painting, type: brushexp export FOLDER to=plan",
    "background=255,128,0": "background=255,128,0 are several values; type background='#ff8000'",
    "resolution=1e3": "is not a whole number; try resolution=1000",
    "+loss=kl": "+loss=kl has no list to add to; type the whole list, loss=[...,kl]",
    "loss=mse,width": "type 'loss=[mse,width]' for all of them, or add -m for a sweep",
    "loss.mse=2": "type loss.mse.<option>=2, one of weight",
    "objective=nan": "objective=nan is not a metric of this painting; choose one of psnr, psnr_focus, ssim",
    "objective=lpips": "is not a metric of this painting; add metric=[psnr,psnr_focus,ssim,l1,edges,perceptual,lpips]",
    "detail=1e3": "detail=1000 makes pixels_per_stroke 0.1, which is not at least 1; try detail=100",
    "effort=1e9": "effort=1e+09 makes steps 5e+11, which is not at most 1e+09; try effort=2e+06",
    "task=benchmark kinds=${seed}": ", which is not a list; type 'kinds=[a,b]'",
    "task=benchmark kinds=${counts}": "kinds holds 150, which is not text; type 'kinds=[a,b]'",
    "task=benchmark counts=${methods}": "counts resolves to null, which is not a list",
    "task=canvas image=coffee canvas=nan": "canvas=nan is not a folder; type canvas=big.zarr",
    "steps=[3,": "cannot be parsed; a list is key=[a,b]",
    "output=nan": "output=nan is not a folder; type output=FOLDER, or output=./nan if that is its name",
    "output=Null": "output=Null is not a folder",
    "output=-inf": "output=-inf is not a folder",
    "output=": "output= is empty; type output=FOLDER",
    "~strokes": "~strokes would delete a key that every run needs; drop it, or type strokes=...",
    "tasks": "type task= and one of analyse, ",
    "look=": "look= does not exist; see all: brushexp look --help",
    "looks": "type look= and one of even, gouache, impasto, ink, oil, ",
    "train src": "task=train takes no path alone; type a key before it, KEY=src",
    "train coffee": "task=train takes no path alone; type a key before it, KEY=coffee",
    "task=analyse rhone.jpg": "is a picture without strokes, not a painting; paint it first, brushexp rhone.jpg",
    "view a.h5 b.h5": "catalogue= takes one path, not 2: a.h5, b.h5",
    "--look=ink": "--look=ink is not a flag; type look=ink, without dashes",
    "time=60": "time is not a key of task=paint; type seconds=... (seconds of optimisation",
    "size=200": "type resolution=... (longer side of the picture in pixels",
    "out=x": "type output=... (folder for the run",
    "brushes=300": "is for tubes=; add tubes=..., or type strokes=...",
    "DPI=300": "type brushexp export FOLDER to=png to.png.size_cm=60x40 to.png.dpi=300, with the FOLDER of a painting",
    "print_size=A4": "to.png.size_cm=60x40",
    "brush-size=3": "brush-size is not a key of task=paint; type strokes=300 for few large ones, or detail=2",
    "colours=5": "colours is not a key of task=paint; type palette=toned palette.values=5 for few tones, or",
    "fps=30": "type timelapse_seconds=10, in which frames=60 pictures are shown",
    "task=film fps=12": "fps is not a key of task=film; type film.every=... (interval between painted frames",
    "task=train brush_size=3": "did you mean batch_size? (see all: brushexp train --help)",
    "speed=fast": "type quality=draft, or seconds=10",
    "task=simulate size=3": "size is not a key of task=simulate; see all: brushexp simulate --help",
    "task=simulate brush_size=3": "brush_size is not a key of task=simulate; see all: brushexp simulate --help",
    "quality=low": "quality=low does not exist; did you mean draft? (see all: brushexp quality --help)",
    "look=van_gogh": "look=van_gogh does not exist; did you mean vangogh? (see all: brushexp look --help)",
    "task=export catalogue=a.h5 to=mp4": "to=mp4 does not exist; did you mean process? (see all: brushexp to --help)",
    "pencil": "did you mean ink?",
    "1920x1080": "type resolution=1920",
    "1000": "type resolution=1000 or strokes=1000",
    "30x40cm": "type brushexp export FOLDER to=png to.png.size_cm=60x40",
    "10s": "type seconds=10",
    "look:oil": "type look=oil",
    "version": "type brushexp --version",
    "-v": "type brushexp --version",
    "steps==100": "steps==100 has one sign too many; type steps=100",
    "resolution=1920x1080": "resolution=1920x1080 is not a whole number; try resolution=1920",
    "resolution=512px": "try resolution=512 (",
    "strokes=1.5k": "try strokes=1500 (",
    "seconds=2min": "seconds=2min is not a number; try seconds=120",
    "threads=all": "try threads=null (number of processor cores",
    "frames=none": "try frames=0 (number of frames of the timelapse",
    "stroke=100": "did you mean strokes? (see all: brushexp --help=all)",
    "psnr=30,5": "psnr=30,5 are several values; type psnr=30.5, or add -m for a sweep",
    "detail=1,5": "type detail=1.5,",
    "seconds=0,125": "type seconds=0.125, o",
    "light.azimuth=-0,5": "type light.azimuth=-0.5,",
    "pixels_per_stroke=1,500": "type pixels_per_stroke=1.500 or pixels_per_stroke=1500, or add -m",
    "pixels_per_stroke=1.000,5": "type pixels_per_stroke=1000.5,",
    "loss.mse.weight=0,5": "type loss.mse.weight=0.5,",
    "optimizer.units.width=0,5": "type optimizer.units.width=0.5,",
    "psnr='30,5'": "psnr='30,5' is not a number; try psnr=30.5",
    "psnr=30,5,6": "psnr=30,5,6 are several values; add -m for a sweep",
    "strokes=30,5": "strokes=30,5 are several values; add -m for a sweep",
    "seed=1,2": "seed=1,2 are several values; add -m for a sweep",
    "strokes=1,000": "is read as several values; type strokes=1000",
    "strokes=many": "try strokes=1000 (number of strokes",
    "seed=range(3)": "seed=range(3) are several values; add -m for a sweep",
    "detail=0": "detail=0 is not above 0",
    "detail=nan": "detail=nan is not above 0",
    "seconds=-1": "seconds=-1 is not above 0; try seconds=60",
    "~logger": "~logger deletes nothing; type logger=[]",
    "~coffee": "~coffee deletes nothing; there is no such key, so drop it",
    "trainer.accelerator=cpu": "is not a key of task=paint; type device=cpu",
    "trainer.fast_dev_run=true": "is not a key of task=paint; type steps=3",
    "trainer.max_epochs=3": "trainer.max_epochs is not a key of task=paint; type steps=100",
    "trainer.accumulate_grad_batches=2": "is not a key of task=paint; type sampler=whole",
    "timelapse=both": "timelapse=both is not one of mp4, gif",
    "lpips_weights=x.pth": r"type +metric=lpips metric.lpips.backbone=alexnet metric.lpips.weights=FILE",
    "logger=none": "logger=none does not exist; type logger=[] for none",
    "learning_rate=0.1": "learning_rate is not a key of task=paint; type painter.lr or optimizer.lr",
    "svg": "svg is not a file, a task or key=value; did you mean to=svg",
    "lr=0.1": "lr is not a key of task=paint; type painter.lr or optimizer.lr",
    "logger.offline=true": "options go below a member, logger.<name>.offline=...",
    "logger.tags=[a]": "is not a key but an option of one logger; type logger.wandb.tags",
    "callbacks=rich_progress_bar": "a plugin can wrap any other callback of Lightning",
    "stepz=3": "stepz is not a key of task=paint; did you mean steps? (see",
    "SEEDS=3": "SEEDS is not a key of task=paint; did you mean seed? (see",
    "n=3": "It is one of task=evaluate, task=prune, task=simulate",
    "film.steps=3": "film is not a key of task=paint; see all: brushexp --help=all. It is one of task=film",
    "experiment=renderer_noise steps=3": "steps is not a key of task=train",
    "style.imag=a.jpg": "style.imag is not a key of task=paint; did you mean style.image? (see",
    "+foo=1": "foo is not a key of task=paint; see all: brushexp --help=all",
    "task=pant": "task=pant does not exist; did you mean paint? (see all: brushexp --help=tasks)",
    "loss=[ms]": "loss=ms does not exist; did you mean mse? (see all: brushexp loss --help)",
    "task=train init=slic": "task=train has no init; it has renderer, engine, ",
    # options of plugins
    "renderer.sof=2": "renderer.sof is not an option of renderer=analytic; did you mean soft? (see all: brushexp rend",
    "order=fixed order.every=2": "order.every is not an option of order=fixed; it has none",
    "renderer.checkpoint=a": "'renderer=analytic','renderer=dual renderer.checkpoint=...'",
    "task=train renderer=analytic": "has no checkpoint, which this task sets; choose renderer=dual or renderer=inverse",
    "+renderer.foo=1": "renderer.foo is not an option of renderer=analytic; see all: brushexp renderer=analytic --help",
    "optimizer.options={foo:1}": "type a plus: '+optimizer.options.foo=...'",
    "+optimizer.options.foo=1": "unexpected keyword argument 'foo' (optimizer.options={",
    "+loss.foo=3": "loss.foo=3 is not an option of any loss; type loss.<name>.foo=3",
    "loss.kl.weight=3": "loss.kl has options but is not chosen; add kl to the list, 'loss=[kl,...]'",
    "loss.ms.weight=3": "loss.ms has options but is not chosen; did you mean mse? (see all: brushexp loss --help)",
    "loss=[mse] ++loss.kl.weight=3": "loss.kl has options but is not chosen (chosen: mse); add it with 'loss=[mse,kl]'",
    "loss=[mse] +loss=kl": "type one list: 'loss=[a,b]'",
    "loss=[]": "no loss is chosen, so nothing can be optimised; try loss=mse",
    "task=export catalogue=a.h5 to=[]": "to=[] writes nothing; choose one or more of ",
    # types and bounds
    "steps=many": "steps=many is not a whole number; try steps=500 (number of gradient steps",
    "steps=null": "steps=null, but steps must have a value; try steps=500",
    "report=perhaps": "report=perhaps is not true or false; try report=true",
    "renderer.soft=wide": "renderer.soft=wide is not a number; try renderer.soft=2.0",
    "optimizer.options=3": "optimizer.options",
    "steps=-1": "steps=-1 is not at least 0; try steps=500",
    "task=prune ratios=[]": "ratios=[] prunes nothing; try 'ratios=",
    "task=train epochs=null minutes=null": "training would never end; set minutes=60",
    "task=prune renderer.checkpoint=null": "there are no trained weights to prune; give those of task=train",
    "task=prune ratios=0,1": "ratios=1 is not 0 to 0.99; try ratios=0.99",
    "style.colors=foo": "style.colors=foo is not one of style, content",
    "trainer.max_time=ten": "ten minutes are trainer.max_time=00:00:10:00",
    "loss=[lpips] loss.lpips.weights=nope.pth": "loss.lpips.weights=nope.pth: there is no such file",
    "callbacks=early_stopping callbacks.early_stopping.monitor=foo": "monitor=foo is not a curve of task=paint; try ",
    "callbacks=model_checkpoint callbacks.model_checkpoint.save_top_k=3": "try callbacks.model_checkpoint.monitor=psnr",
    "loss=[perceptual] loss.perceptual.taps=[a]": "loss.perceptual.taps: 'a' names no activation",
    "loss.mse.weight=-1": "loss.mse.weight=-1 is not at least 0; try loss.mse.weight=1",
    "warm_up=nope": "warm_up=nope is not a renderer; choose auto, null or one of analytic",
    "task=export": "task=export needs catalogue: folder of a run, its catalogue.h5",
    "task=canvas": "task=canvas needs image: picture file of any size, or an OME-Zarr image; add image=...",
    "image=a'b.jpg strokes='": "is not a whole number; try strokes=100",
    # names and files
    "device=tpu": "device=tpu, but PyTorch finds ",
    "device=cuda:7": "CUDA devices; use device=cpu",
    "optimizer.name=Adm": "choose optimizer.name from ASGD, ",
    "background=#ff000080": "is not a colour; use",
    "background=notacolor": "background=notacolor is not a colour; use background=mean, transparent, '#rrggbb' or",
    "image=nope.jpg": "image=nope.jpg is not there; give the path of a picture, or a sample such as coffee",
    "focus=nope.jpg": "focus=nope.jpg is not there; give auto, the path",
    "catalogue=nope.h5": "there is no file nope.h5; give the folder of a finished run, catalogue=outputs/x",
    "resume=nope": "resume=nope: there is no such folder; give the folder of an interrupted run",
    "resume=": "resume= is empty; give the folder of an interrupted run",
    "renderer=neural renderer.checkpoint=nope": "renderer.checkpoint=nope is not a shipped checkpoint (there are: ",
    "init=predicted init.checkpoint=nope": "init.checkpoint=nope is not a shipped checkpoint (there are: brushed, ",
    "renderer=inverse_vgg renderer.channels=[3]": "renderer.channels=[3] are not ",
    "task=view catalogue=nope": "there is no file nope",
    "task=compare runs=nope": "runs=nope: there is no such folder; give the folder of a run or of a sweep",
    "task=train data=nope": "there is no set of strokes at nope; make one with brushexp task=simulate path=nope",
    "task=extremes renderers=[nope]": "renderers has no 'nope'; leave renderers at null for all, or choose",
    # what newcomers type
    "oill": "did you mean oil?",
    "god": "god is not a file, a task or key=value; brushexp --help lists",
    "expotr": "did you mean export? brushexp --help lists",
    "losses": "did you mean loss=?",
    "quality=god": "quality=god does not exist; see all: brushexp quality --help",
    "to=pdff": "did you mean pdf? There are annotations, bits, csv, ",
    "to=xyz": "to=xyz does not exist; there are annotations, bits, csv, ",
    "to=tif": "to=tif does not exist; did you mean png?",
    "strokes": "strokes is a key; type strokes=1000, without spaces (number of strokes; ",
    "strokes 100": "strokes 100 needs an equals sign instead of the space; type strokes=100",
    "strokes = 100": "type strokes=100",
    "look oil": "type look=oil",
    "look coffee=1": "look has no meaning alone; type look= and one of ",
    "--look oil": "--look is not a flag; type look=oil, without dashes",
    "-look=oil": "-look=oil is not a flag; type look=oil, without dashes",
    "--quality": "--quality is not a flag; type quality=..., without dashes",
    "Look=Oil": "Look is not a key of task=paint; did you mean look? (see",
    "look=Oil": "look=Oil does not exist; did you mean oil? (see all: brushexp look --help)",
    "strokes=": "strokes= is empty; type strokes=1000, or drop it",
    "report=": "report= is empty; type report=true, or drop it",
    "azimuth=40": "azimuth is not a key of task=paint; did you mean light.azimuth? (see",
    "resol=512": "did you mean resolution? (see",
    "resolution=0": "resolution=0 is not 1 to 16384; try resolution=1024",
    "resolution=20cm": "try resolution=1024 (longer side of the picture in pixels",
    "psnr=high": "psnr=high is not a number; try psnr=30 (",
    "strokes=abc": "strokes=abc is not a whole number; try strokes=1000 (",
    "abstraction=70": "abstraction=70 is not 0 to 1; try abstraction=0.7",
    "wet=yes": "wet=yes is not a number; try wet=0.5",
    "docs/images/brushify.jpg painting.png": "image=painting.png is not there; give the path of a picture, or a sample "
    "such as coffee; for a folder of results, type output=FOLDER",
    # combinations
    "style.image=chelsea loss=[mse,style]": "style.image=chelsea adds the loss style itself; drop style",
    "loss=brushwork": "set loss.brushwork.catalogue=catalogue.h5",
    "strokes=100000 resolution=64": "strokes=100000 is more than the 64 x 64 picture has pixels; set strokes to 4096",
    "focus=chelsea": "focus=chelsea has 451 x 300 pixels, the picture 512 x 512; give one with",
    "timelapse_seconds=0.01": "timelapse_seconds=0.01 does not fit; choose 1.2 to ",
    "task=train simulate=null limit=9": "limit=9 is for stored sets",
    "task=train_discriminator simulate=300": "simulate is not a key of task=train_discriminator; see all: brushexp",
    "task=train renderer.window=128": "renderer.window=128, but the strokes have 64 pixels; set renderer.window=64",
    "task=prune renderer=textured": "Textured has no option for the widths of its layers; use renderer=inverse_vgg",
}


@pytest.mark.parametrize("overrides", MISTAKES)
def test_a_message_says_what_to_type_instead(config, overrides, monkeypatch):
    monkeypatch.chdir(ROOT)
    words = overrides.split(" ")
    with pytest.raises((UserError, CompactHydraException, OmegaConfBaseException)) as error:
        check(config(*words), words)
    message = explanation(error.value, conf_folders(), words)
    assert MISTAKES[overrides] in message
    assert "\n" not in message


@pytest.mark.parametrize(("typed", "meant"), [
    ("to=svg,json", "to=[svg,json]"),
    ("photo.jpg", "image=photo.jpg"),
    ("astronaut", "image=astronaut"),
    ("train", "task=train"),
    ("ratios=0,0.5", "ratios=[0,0.5]"),
    ("look=glob(*)", "look=glob(*)"),
    ("data=a b.h5", "data=[a b.h5]"),
    ("data=a&b.h5,c.h5", 'data=["a&b.h5",c.h5]'),
    ("catalogue=null", "catalogue=null"),
    ("-m data=a,b", "-m data=[a],[b] working_resolution=null"),
    ("-m to=svg,json", "-m to=svg,json working_resolution=null"),
    ("light=315,45", "light={azimuth:315,elevation:45}"),
    ("light=[-20.5,45]", "light={azimuth:-20.5,elevation:45}"),
    ("style=a.jpg", "style.image=a.jpg"),
    ("watercolor", "look=watercolour"),
    ("look=watercolor", "look=watercolour"),
    ("colour=rgb", "color=rgb"),
    ("finer", "detail=2"),
    ("best", "quality=best"),
    ("timelapse=none", "frames=0"),
    ("faces=none", "faces=off"),
    ("resume=a,b", "resume=a,b output=\"a,b\""),
    ("export a.h5 to=svg", "task=export catalogue=a.h5 to=[svg]"),
    ("view tests", "task=view catalogue=tests"),
    ("compare src tests", "task=compare runs=[src,tests]"),
    ("--config-dir mine steps=3", "--config-dir mine steps=3"),
])  # fmt: skip
def test_short_forms_are_written_out(typed, meant):
    several = typed.startswith(("-", "resume", "export", "view", "compare"))
    words = [text.split(" ") if several else [text] for text in (typed, meant)]
    assert expand_arguments(words[0]) == words[1]


def test_a_flag_that_cannot_be_is_told_in_a_line_and_the_home_folder_is_found_behind_a_key(monkeypatch):
    refuses("--help/-h: ignored explicit argument 'elp'; --help lists the keys", expand_arguments, ["-help"])
    monkeypatch.setenv("HOME", "/home/me")
    assert expand_arguments(["output=~/x", "image=~/a.jpg"]) == ["output=/home/me/x", 'image="~/a.jpg"']
    assert expand_arguments(["view", "catalogue=~"]) == ["task=view", "catalogue=/home/me"]
    words = ["-m", "steps=1", "--cfg", "job", "~order", "--package=loss"]
    assert settings_first(words) == ["steps=1", "~order", "-m", "--cfg", "job", "--package=loss"]


@pytest.mark.parametrize(("bounds", "fine", "wrong", "message"), [
    (at_least(1), [1, 7], 0, "x=0 is not at least 1; try x=3"),
    (at_least(1, typical=9), [1, 7], 0, "x=0 is not at least 1; try x=9"),
    (at_least(5), [5], 0, "x=0 is not at least 5; try x=5"),
    (between(0, 1), [1], 70, "x=70 is not 0 to 1; try x=0.7"),
    (between(0, 1), [0, 0.5, 1.0, None], 1.5, "x=1.5 is not 0 to 1; try x=1"),
    (above(0), [1e-9, 5], 0.0, "x=0 is not above 0; try x=3"),
    (above(0, 10), [10], 11, "x=11 is not above 0 and at most 10; try x=10"),
    (multiple_of(16, 64), [16, 64], 40, "x=40 is not a multiple of 16, 16 to 64; try x=32"),
    (multiple_of(16), [16, 640], 3, "x=3 is not a multiple of 16, at least 16; try x=16"),
    (one_of("red", "green"), ["red"], "gren", "x=gren is not one of red, green; try x=green"),
    (at_least(0), [0.0], float("nan"), "x=nan is not at least 0; try x=3"),
    (between(0, 9), [[], [0, 9], {"a": 3}], [3, -1], "x=-1 is not 0 to 9; try x=0"),
    (between(0, 9), [], {"a": 10}, "x=10 is not 0 to 9; try x=9"),
])  # fmt: skip
def test_bounds_hold_and_propose_a_value_that_a_user_may_want(bounds, fine, wrong, message):
    for value in fine:
        bounds.check("x", value)
    refuses(f"^{re.escape(message)}$", bounds.check, "x", wrong, 3)


@pytest.mark.parametrize("task", TASKS)
def test_every_number_has_a_value_to_propose_within_its_bounds(task):
    for name, key in keys_of(TASKS[task]).items():
        if type_of_key(name, task)[0] in (int, float) and key.default != "???":
            assert key.example() != "...", f"{name} needs a typical value beside its bounds"
            key.bounds.check(name, key.example())


@pytest.mark.parametrize("task", TASKS)
def test_every_key_has_a_meaning_in_the_help_and_a_default_within_its_bounds(config, task):
    text = help_text(config(f"task={task}", "seed=77"), [], conf_folders(), "all")
    assert "  seed=77 " in text
    assert "``" not in text, "markup of docstrings"
    for name, key in keys_of(TASKS[task]).items():
        assert f"  {name}=" in text
        assert 3 <= len(key.meaning) <= 110, name
        assert key.meaning in " ".join(text.split()), name
        if key.default != "???":
            key.bounds.check(name, key.default)


@pytest.mark.parametrize(("typed", "said"), [
    ("", "painting astronaut in oil"),
    ("photo.jpg", "painting photo.jpg in oil"),
    ("photo.jpg watercolor finer", "painting photo.jpg in watercolour"),
    ("image=photo.jpg look=vangogh", "painting photo.jpg after van Gogh"),
    ("coffee style=photo.jpg", "painting coffee in oil, in the style of photo.jpg"),
    ("photos", "painting the pictures of photos in oil"),
    ("a=b.jpg pastel", "painting a=b.jpg in pastel"),
    ("phto.jpg", ""),
    ("--help", ""),
    ("photo.jpg --cfg job", ""),
    ("export outputs/x", "starting: export"),
    ("task=train minutes=3", "starting: train"),
    ("-m seed=1,2", "checking the jobs of a sweep"),
    ("experiment=losses", "checking the jobs of a sweep"),
    ("resume=outputs/x", "continuing outputs/x"),
])  # fmt: skip
def test_the_first_line_says_what_begins(typed, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("photo.jpg", "a=b.jpg"):
        (tmp_path / name).touch()
    (tmp_path / "photos").mkdir()
    assert opening_line(typed.split()) == said


def test_letters_that_the_terminal_has_not_are_escaped_and_a_folder_that_is_gone_is_told_at_once(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "stdout", TextIOWrapper(BytesIO(), "ascii"))
    open_with(["coffee"])
    print("é\udcff.png", flush=True)
    assert sys.stdout.buffer.getvalue() == b"\\xe9\\udcff.png\n"
    (gone := tmp_path / "gone").mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(SystemExit, match="the current folder no longer exists; change to another folder with cd"):
        open_with(["coffee"])


def test_the_terminal_gets_plain_words_and_leaves_figures_to_the_log(capsys, caplog, tmp_path, monkeypatch):
    log = logging.getLogger("plain")
    monkeypatch.setattr(log, "handlers", [Terminal()])
    monkeypatch.setattr(log, "propagate", False)
    log.setLevel(logging.INFO)
    log.info("writing the page")
    log.info("24.5 dB", extra=IN_LOG)
    for _ in range(2):  # as in jobs of a sweep
        log.warning("it is slow")
    log.error("it is broken\nb\x1b[2J.png")
    assert capsys.readouterr() == ("writing the page\n", "note: it is slow\nbrushexp: it is broken\nb\\x1b[2J.png\n")
    with caplog.at_level(logging.INFO), showing("painting") as show:  # a pipe gets lines instead of a bar
        monkeypatch.setattr(logging.getLogger("brushexp.system.progress"), "handlers", [Terminal()])
        show(0.5, "step 3 of 6, 24.50 dB")
    assert "painting: 50 %, step 3 of 6, 24.50 dB, 0:00:00 left" in caplog.messages, "run.log has the figures"
    assert capsys.readouterr().out == "painting: 50 %, step 3 of 6, 0:00:00 left\n"
    monkeypatch.chdir(tmp_path)
    assert (as_shown(tmp_path / "a" / "b"), as_shown(tmp_path.parent)) == ("a/b", str(tmp_path.parent))


class Screen(StringIO):
    """A stream that claims to be a terminal if ``is_terminal`` is true."""

    def __init__(self, is_terminal):
        super().__init__()
        self.isatty = lambda: is_terminal


@pytest.mark.parametrize(("is_terminal", "kind", "letters", "has_bar"), [
    (True, "xterm", 100, True),
    (True, "xterm", 40, True),
    (True, "dumb", 80, False),
    (False, "xterm", 80, False),
])  # fmt: skip
def test_a_bar_is_for_terminals_that_can_show_it_and_says_the_time_on_narrow_ones(
    is_terminal, kind, letters, has_bar, monkeypatch, caplog
):
    for name, value in {"TERM": kind, "COLUMNS": str(letters), "FORCE_COLOR": "1"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stderr", Screen(is_terminal))
    with caplog.at_level(logging.INFO), showing("painting the film") as show:
        show(0.5, "step 3 of 6")
        show(1.0, "step 6 of 6")
    shown = sys.stderr.getvalue()
    assert bool(shown) == has_bar
    assert has_bar == (not caplog.messages), "lines of the log stand for a bar"
    if has_bar:
        assert "100%" in shown
        assert "0:00:00" in shown.rpartition("left")[2]
        assert ("step 6 of 6" in shown) == (letters == 100)


@pytest.mark.parametrize("closed", [("stderr",), ("stdin", "stdout", "stderr")])
def test_streams_that_are_closed_stop_nothing(closed, monkeypatch):
    for name in closed:
        monkeypatch.setattr(sys, name, None)
    open_with(["coffee"])
    print("nobody reads it", file=sys.stderr)
    assert not sys.stderr.isatty()
    for name in closed:
        getattr(sys, name).close()


@pytest.mark.parametrize(("typed", "said"), [
    ([], []),
    (["hydra/launcher=joblib"], ["hydra/launcher=joblib"]),
    (["hydra/launcher=processes", "hydra.launcher.n_jobs=2"], ["jobs=2"]),
])  # fmt: skip
def test_a_launcher_of_a_single_run_is_told(typed, said, caplog):
    warn_of_launcher(OmegaConf.create({"hydra": {"overrides": {"hydra": typed}}}))
    told = "has no effect on a single run; use it for several pictures or a sweep: -m seed=0,1"
    assert caplog.messages == [f"{word} {told}" for word in said]


def test_a_name_with_a_space_needs_quotes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my photo.jpg").touch()
    refuses(
        "the name my photo.jpg has a space; type it in quotes: 'my photo.jpg'", expand_arguments, ["my", "photo.jpg"]
    )
    assert expand_arguments(["my photo.jpg"]) == ["image=my photo.jpg"]


@pytest.mark.parametrize(("typed", "meant"), [
    ("look --help", (["look=", "--help"], "")),
    ("losses loss --help", (["losses", "loss=", "--help"], "")),
    ("--help=looks", (["--help", "look="], "")),
    ("train renderer -h", (["train", "renderer=", "-h"], "")),
    ("export --help=all", (["export", "--help"], "all")),
    ("look", (["look"], "")),
])  # fmt: skip
def test_a_family_alone_asks_for_the_help_of_its_members(typed, meant):
    assert words_and_topic(typed.split()) == meant


def test_the_help_of_a_family_has_no_markup_and_tells_qualities_apart(config):
    text = help_text(config(), ["loss="], conf_folders())
    assert "less sensitive to outliers than mse" in " ".join(text.split())
    assert "``" not in text
    lines = help_text(config(), ["quality="], conf_folders()).split("\n  ")
    figures = [re.findall(r"\(.*dB in .* s\)", " ".join(line.split())) for line in lines]
    shown = [one for found in figures for one in found]
    assert len({*shown}) == len(shown) > 2


def test_runs_of_one_second_have_folders_of_their_own(config, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second, named = config(), config(), config("output=outputs/mine")
    place = Path(first.output)
    OmegaConf.copy_cache(first, second)  # the same moment
    assert take_name(first, Path(first.output)) == place
    assert take_name(second, Path(second.output)) == Path(f"{place}_2")
    assert (first.output, second.output) == (str(place), f"{place}_2"), "and so for every job of a sweep"
    assert take_name(named, Path(named.output)) == Path("outputs/mine")


def test_a_run_says_where_its_profile_is_and_goes_on_in_its_own_folder(tmp_path):
    words = ["chelsea", "resolution=16", "strokes=4", "steps=3", "frames=0", "threads=1", "report=false", "output=a"]
    code, output = ended(tmp_path, *words, "trainer.profiler=simple")
    assert code == 0, output
    assert "a/profile.txt  time spent in each part" in output
    assert "FIT Profiler Report" in (tmp_path / "a" / "profile.txt").read_text()
    kill = ("checkpoint.ckpt", 1, True)
    assert ended(tmp_path, *words[:-1], "output=b", "checkpoint_every=0", kill=kill)[0] < 0
    code, output = ended(tmp_path, "resume=b")
    assert code == 0, output
    assert "b/painting.png" in output
    assert not (tmp_path / "outputs").exists()
