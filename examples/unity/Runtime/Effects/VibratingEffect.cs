using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Vibration along the object's y. Not passive: it works like a motor.</summary>
    [AddComponentMenu("Tensionlab/Vibrating")]
    public class VibratingEffect : HapticEffect
    {
        [Min(0f), Tooltip("Amplitude A, in N.")]
        public float amplitude = 1f;
        [Min(0.001f), Tooltip("Frequency f, in Hz.")]
        public float frequency = 40f;

        protected override string Kind { get { return "vibrating"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["axis"] = rig.Direction(transform.up);
            parameters["amplitude"] = amplitude;
            parameters["frequency"] = frequency;
        }
    }
}
