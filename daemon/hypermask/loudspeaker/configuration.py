"""The ALSA configuration, the udev rules and the environment of the unit, from the settings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from hypermask.loudspeaker.settings import Loudspeaker, Microphone, Notch, SoundSettings
from hypermask.storage import write_atomically

LIMITER_S = 0.005
"""How far the limiter looks ahead (swh-plugins, fast_lookahead_limiter_1913)."""
_LEAST_LOOP_S = 0.008
_KEY = 0x48595031
_PLUGINS = "/usr/lib/ladspa"

ASOUND, ENVIRONMENT, RULES = "asound.conf", "loudspeaker.env", "90-hypermask-sound.rules"


def asound_conf(
    sound: SoundSettings, microphone: str | None = None, loudspeaker: str | None = None
) -> str:
    """The PCMs hypermask_mic (to analyse), hypermask_voice (to play) and hypermask_loudspeaker.

    microphone, loudspeaker: definitions of PCMs in the place of the cards, to try it without any.
    """
    mic, out = sound.microphone, sound.loudspeaker
    parts = [
        "# Written by hypermask from the machine's settings; changes here are lost.",
        microphone_conf(mic, microphone),
        voice_conf(mic, out),
        loudspeaker_conf(out, loudspeaker),
    ]
    return "\n\n".join(parts) + "\n"


def microphone_conf(mic: Microphone, instead: str | None = None) -> str:
    """One card, many listeners; their time stamps are CLOCK_MONOTONIC."""
    period = max(16, round(mic.rate_hz * mic.period_ms * 1e-3))
    shared = (
        instead
        or f"""{{
    type dsnoop
    ipc_key {_KEY}
    ipc_perm 0660
    tstamp_type monotonic
    slave {{
        pcm {{ type hw card {mic.card} device {mic.device} }}
        format {mic.format}
        rate {mic.rate_hz}
        channels {mic.channels}
        period_size {period}
        buffer_size {64 * period}
    }}
}}"""
    )
    return f"""pcm.hypermask_mic_shared {shared}

pcm.hypermask_mic {{
    type plug
    slave {{ pcm hypermask_mic_shared rate {mic.rate_hz} channels {mic.channels} }}
    hint {{ show on description "HYPERMASK: microphone in the mask, shared" }}
}}"""


def voice_conf(mic: Microphone, out: Loudspeaker) -> str:
    """The microphone's channel, cleaned: what the loudspeaker is to play."""
    plugins = list(_voice_plugins(out))
    behind, chain = "hypermask_mic_mono", ""
    if plugins:
        behind = "hypermask_voice_clean"
        chain = "\n\n" + _ladspa(behind, "hypermask_mic_mono", plugins, channels=1)
    return f"""pcm.hypermask_mic_mono {{
    type plug
    slave {{ pcm hypermask_mic_shared rate {mic.rate_hz} channels {mic.channels} }}
    ttable.0.{mic.channel} 1
}}{chain}

pcm.hypermask_voice {{
    type plug
    slave {{ pcm {behind} rate {mic.rate_hz} channels 1 }}
    hint {{ show on description "HYPERMASK: the actor's voice behind gate and notches" }}
}}"""


def loudspeaker_conf(out: Loudspeaker, instead: str | None = None) -> str:
    """Mono in; gain, limiter, the same on every channel.

    With a limiter the gain is the limiter's, which has the room above full scale.
    """
    card = (
        instead
        or f"""{{
    type hw
    # Another one where there is no card of that name: see debian/libexec/loudspeaker.
    card {{ @func getenv vars [ HYPERMASK_OUT ] default "{out.card}" }}
    device {out.device}
}}"""
    )
    if not out.limiter.on:
        gain = 10 ** (out.gain_db / 20)
        return _out(out, card, "hypermask_out_card", out.channels, gain)
    limited = _ladspa("hypermask_limited", "hypermask_out_spread", [_limiter(out)], channels=2)
    spread = f"""pcm.hypermask_out_spread {{
    type plug
    slave {{ pcm hypermask_out_card rate {out.rate_hz} channels {out.channels} }}
{_from_two(out.channels)}
}}

{limited}

"""
    return _out(out, card, "hypermask_limited", 2, 1.0, spread)


def _out(
    out: Loudspeaker, card: str, slave: str, channels: int, gain: float, between: str = ""
) -> str:
    table = "\n".join(f"    ttable.0.{k} {gain:.6f}" for k in range(channels))
    return f"""pcm.hypermask_out_card {card}

{between}pcm.hypermask_loudspeaker {{
    type plug
    slave {{ pcm {slave} rate {out.rate_hz} channels {channels} }}
{table}
    hint {{ show on description "HYPERMASK: the loudspeaker behind its limiter" }}
}}"""


def environment(sound: SoundSettings) -> str:
    """What the unit needs to start alsaloop: its arguments, and the names of both cards.

    Its latency is the delay less that of the limiter. Two cards have two quartzes: alsaloop then
    resamples (sync 4) to stay together.
    """
    out = sound.loudspeaker
    words = [
        "--cdevice=hypermask_voice", "--pdevice=hypermask_loudspeaker", "--format=S16_LE",
        f"--rate={out.rate_hz}", "--channels=1", f"--tlatency={round(loop_s(out) * 1e6)}",
        f"--sync={0 if sound.microphone.card == out.card else 4}",
    ]  # fmt: skip
    # A loudspeaker whose socket is known is no other card.
    spare = out.card if out.usb else sound.microphone.card
    return (
        f'HYPERMASK_LOOP="{" ".join(words)}"\nHYPERMASK_OUT={out.card}\nHYPERMASK_SPARE={spare}\n'
    )


def loop_s(out: Loudspeaker) -> float:
    """The latency that alsaloop keeps, seconds."""
    fixed_s = LIMITER_S if out.limiter.on else 0.0
    return max(out.delay_ms * 1e-3 - fixed_s, _LEAST_LOOP_S)


def udev_rules(sound: SoundSettings) -> str:
    """Names cards by the socket they are in; a card's number is another at each start.

    At "change" (sent when all of a new card is there) so that what it can do is known. A card that
    records and plays is the microphone, unless the microphone's socket is known: where no other
    card plays, the voice comes out of it too (debian/libexec/loudspeaker).

    Lines of another form do not pass debian/libexec/sound-names.
    """
    mic, out = sound.microphone, sound.loudspeaker
    with_out = out.card != mic.card
    rules = list(_by_socket(mic.card, mic.usb))
    if with_out:
        rules += _by_socket(out.card, out.usb)
    if mic.usb is None:
        rules.append(_named('SUBSYSTEMS=="usb", TEST=="pcmC%nD0c"', mic.card))
    if with_out and out.usb is None:
        plays = 'SUBSYSTEMS=="usb", TEST=="pcmC%nD0p"'
        rules.append(_named(plays if mic.usb else f'{plays}, TEST!="pcmC%nD0c"', out.card))
    return "\n".join(
        [
            "# Written by hypermask: sound cards get names by the USB sockets they are in.",
            'ACTION!="change", GOTO="hypermask_sound_end"',
            'SUBSYSTEM!="sound", GOTO="hypermask_sound_end"',
            'KERNEL!="card[0-9]*", GOTO="hypermask_sound_end"',
            *rules,
            'LABEL="hypermask_sound_end"',
            "",
        ]
    )


def _by_socket(card: str, usb: str | None) -> Iterator[str]:
    if usb is not None:
        yield _named(f'KERNELS=="{usb}"', card)
        yield f'KERNELS=="{usb}", GOTO="hypermask_sound_end"'


def _named(which: str, card: str) -> str:
    return f'{which}, ATTR{{id}}!="{card}", ATTR{{id}}="{card}"'


def write(sound: SoundSettings, folder: Path) -> list[Path]:
    """All files into `folder`; without a loudspeaker there is no environment, and the unit rests.

    Raises `HypermaskError` DISK-WRITE.
    """
    files = {ASOUND: asound_conf(sound), RULES: udev_rules(sound)}
    if sound.loudspeaker.on:
        files[ENVIRONMENT] = environment(sound)
    else:
        (folder / ENVIRONMENT).unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        write_atomically(folder / name, text.encode())
    return [folder / name for name in files]


def _voice_plugins(out: Loudspeaker) -> Iterator[str]:
    gate = out.gate
    if gate.on:
        controls = [
            80, 8000, gate.threshold_db, gate.attack_ms, gate.hold_ms, gate.decay_ms,
            gate.range_db, 0,
        ]  # fmt: skip
        yield _plugin("gate", "gate_1410", controls)
    for notch in out.notches:
        yield _notch(notch)


def _notch(notch: Notch) -> str:
    """A dip of the parametric equaliser: the pack's own notch filter is shallow."""
    return _plugin("singlePara", "single_para_1203", [notch.depth_db, notch.hz, notch.octaves])


def _limiter(out: Loudspeaker) -> str:
    controls = [out.gain_db, out.limiter.limit_db, out.limiter.release_s]
    return _plugin("fastLookaheadLimiter", "fast_lookahead_limiter_1913", controls)


def _plugin(label: str, file: str, controls: list[float]) -> str:
    numbers = " ".join(f"{value:.6g}" for value in controls)
    return f'{{ label {label} filename "{_PLUGINS}/{file}.so" input {{ controls [ {numbers} ] }} }}'


def _ladspa(name: str, slave: str, plugins: list[str], channels: int) -> str:
    """A chain of plugins on float samples; only a plug may stand before and behind it."""
    chain = "\n".join(f"        {k} {plugin}" for k, plugin in enumerate(plugins))
    return f"""pcm.{name} {{
    type ladspa
    slave.pcm {slave}
    path "{_PLUGINS}"
    channels {channels}
    plugins {{
{chain}
    }}
}}"""


def _from_two(channels: int) -> str:
    """The limiter has two channels; every channel of the card gets one of them."""
    return "\n".join(f"    ttable.{k % 2}.{k} 1" for k in range(channels))
