"""Simulated records of cutting tests with known means: drift, air cuts, entry ramps, ripple and noise."""

import datetime

import numpy as np


def cut_signal(means, rate, rng, *, n=600.0, seconds=8.0, air=3.0, gap=4.0, drift=0.03, ripple=0.02, noise=0.02,
               ramp=0.2, air_cut=0.02, teeth=0.15):  # fmt: skip
    """A record of cuts with these means: time, signal, true zero, and the span of each cut.

    ``drift``, ``ripple``, ``noise``, ``air_cut`` and ``teeth`` are shares of the mean of all cuts.
    """
    size = float(np.mean(means))
    begins = air + np.arange(len(means)) * (seconds + gap)
    t = np.arange(int((begins[-1] + seconds + air) * rate)) / rate
    zero = size * drift * (t / t[-1] + 0.2 * np.sin(np.pi * t / t[-1]))
    load = np.zeros_like(t)
    for begin, mean in zip(begins, means, strict=True):
        end = begin + seconds
        shape = np.clip((t - begin) / ramp, 0, 1) * np.clip((end - t) / ramp, 0, 1)
        inside = shape > 0
        turning = 1 + teeth * np.sin(2 * np.pi * n / 60 * t) if rate > n / 10 else 1.0
        burst = 1 + 0.4 * np.exp(-(((t - begin - ramp) / 0.05) ** 2))
        load = np.where(inside, mean * shape * turning * burst, load)
        moving = (t > begin - 1.0) & (t < begin - 0.2)
        load = np.where(moving & ~inside, air_cut * size, load)
    mains = ripple * size * np.sin(2 * np.pi * 50 * t + 1) if rate > 200 else 0.0
    signal = zero + load + mains + noise * size * rng.standard_normal(t.size)
    return t, signal, zero, [(b, b + seconds) for b in begins]


def write_table(path, t, channels, *, header=None, comment="# simulated: no measurement", mark=",", digits=6):
    names = header or ["time [s]", *channels]
    columns = np.column_stack([t, *channels.values()])
    with path.open("w") as file:
        file.write(f"{comment}\n{mark.join(names)}\n")
        np.savetxt(file, columns, fmt=f"%.{digits}g", delimiter=mark)


def write_tdms(path, rate, channels, group="run"):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment([
            ChannelObject(group, name.split(" [")[0], values, properties={
                "wf_increment": 1 / rate, "wf_start_offset": 0.0, "wf_samples": len(values),
                "unit_string": name.split("[")[1].rstrip("]") if "[" in name else "",
            })
            for name, values in channels.items()
        ])  # fmt: skip


def write_lvm(path, rate, channels):
    k = len(channels)
    names, units = [name.split(" [")[0] for name in channels], [name.split("[")[1].rstrip("]") for name in channels]
    n = len(next(iter(channels.values())))
    today = datetime.date(2024, 3, 1).strftime("%Y/%m/%d")
    lines = [
        *("LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t."),
        *("Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative", f"Date\t{today}", "Time\t12:00:00"),
        *("***End_of_Header***\t", "\t", "\t".join(["Channels", str(k)]), "\t".join(["Samples", *[str(n)] * k])),
        "\t".join(["Date", *[today] * k]), "\t".join(["Time", *["12:00:00"] * k]),
        "\t".join(["Y_Unit_Label", *units]), "\t".join(["X_Dimension", *["Time"] * k]),
        "\t".join(["X0", *["0.0"] * k]), "\t".join(["Delta_X", *[f"{1 / rate:.9g}"] * k]),
        "***End_of_Header***\t" + "\t" * k, "\t".join(["X_Value", *names, "Comment"]),
    ]  # fmt: skip
    columns = np.column_stack([np.arange(n) / rate, *channels.values()])
    lines += ["\t".join(f"{v:.6f}" for v in row) for row in columns]
    path.write_text("\n".join(lines) + "\n")


def write_mat(path, rate, channels, *, hdf=False):
    held = {name.split(" [")[0]: values for name, values in channels.items()}
    if hdf:
        import h5py

        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in held.items():
                file[name] = np.asarray(values)[None, :]
            file["fs"] = np.array([[float(rate)]])
        data = bytearray(path.read_bytes())
        data[:124] = b"MATLAB 7.3 MAT-file".ljust(124)
        data[124:128] = b"\x00\x02IM"
        path.write_bytes(bytes(data))
        return
    from scipy.io import savemat

    savemat(path, {**{name: np.asarray(v)[:, None] for name, v in held.items()}, "fs": float(rate)})
