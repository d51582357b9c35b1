using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Bow, for the hand that draws it; the other hand is at the rig's origin. Call Release.</summary>
    [AddComponentMenu("Tensionlab/Bow")]
    public class BowEffect : HapticEffect
    {
        [Min(0f), Tooltip("Distance of the string undrawn, in m.")]
        public float brace = 0.2f;
        [Min(0f), Tooltip("Pull F_0 at which the draw begins, in N.")]
        public float initial = 1f;
        [Min(0f), Tooltip("Stiffness k, in N/m.")]
        public float stiffness = 8.3f;
        [Min(0f), Tooltip("Largest pull F_max, in N.")]
        public float most = 6f;
        [Min(0.0001f), Tooltip("Draw x_d, in m, where it is fully drawn, and a brake may lock.")]
        public float drawLength = 0.6f;

        double loosed = double.NaN;

        /// <summary>Let the string go now; Nock makes it ready again.</summary>
        public void Release()
        {
            if (bridge != null && bridge.State != null) loosed = bridge.State.Time;
        }

        public void Nock()
        {
            loosed = double.NaN;
        }

        protected override string Kind { get { return "bow"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["brace"] = brace;
            parameters["initial"] = initial;
            parameters["stiffness"] = stiffness;
            parameters["most"] = most;
            parameters["draw_length"] = drawLength;
            if (!double.IsNaN(loosed)) parameters["loosed"] = loosed;
        }
    }
}
