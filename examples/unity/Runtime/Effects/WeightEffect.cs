using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Mass in the hand: gravity along Unity's -y, and its inertia.</summary>
    [AddComponentMenu("Tensionlab/Weight")]
    public class WeightEffect : HapticEffect
    {
        [Min(0f), Tooltip("Mass m, in kg.")]
        public float mass = 0.5f;
        [Min(0.001f), Tooltip("Cutoff of the low-pass on the acceleration, in Hz.")]
        public float cutoff = 10f;
        [Min(0f), Tooltip("Limit of each component of the acceleration, in m/s².")]
        public float limit = 5f;
        [Min(0.0001f), Tooltip("Time in which its force then rises, in s.")]
        public float ramp = 0.1f;

        protected override string Kind { get { return "weight"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["gravity"] = rig.Direction(9.81f * Vector3.down);
            parameters["mass"] = mass;
            parameters["cutoff"] = cutoff;
            parameters["limit"] = limit;
            parameters["ramp"] = ramp;
        }
    }
}
